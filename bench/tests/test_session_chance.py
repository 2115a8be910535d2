# SPDX-License-Identifier: Apache-2.0
"""How much of a ratio of errors is chance: maps severed at cuts, and runs begun later."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bench.session_chance import LEFT_OUT, chance_row, events_from, severed_trajectory
from bench.session_measures import Drive
from cartoloop.config import Config
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.result import Result
from cartoloop.sensor.events import Odometry, SensorEvent
from cartoloop.sensor.pose import IDENTITY
from cartoloop.simulation.recording import Recording

WRONG_BY = 0.5
NUM_SCANS = 200


def _uncut() -> Result:
    """Return a map of four nodes, a metre apart, and the chain misses half a metre of them."""
    truth = np.column_stack((np.arange(4.0), np.zeros(4), np.zeros(4)))
    graph = PoseGraph()
    graph.add_submaps(np.zeros((2, 3)))
    graph.add_nodes(truth)
    nodes = np.array([0, 1, 2, 2, 3])
    inside = truth[nodes]
    inside[2, 0] += WRONG_BY  # in the first submap
    graph.add_constraints(
        ConstraintKind.INTRA_SUBMAP, [0, 0, 0, 1, 1], nodes, inside, [np.eye(3) * 1e4] * 5
    )
    graph.add_constraints(ConstraintKind.LOOP_CLOSURE, [1], [1], truth[1:2], [np.eye(3)])
    return cast(
        Result,
        SimpleNamespace(
            graph=graph,
            node_scan_index=np.arange(4),
            stamps=np.arange(4.0),
            local_trajectory=truth,
            config=Config(),
        ),
    )


@pytest.mark.parametrize(("count", "step"), [(2, 1.0), (1, 1.0 + WRONG_BY)])
def test_only_closures_connect_what_is_severed(count: int, step: float) -> None:
    uncut = _uncut()
    trajectory = severed_trajectory(uncut, count)
    assert trajectory[2, 0] - trajectory[1, 0] == pytest.approx(step, abs=1e-3)
    assert uncut.graph.num_constraints == 6, "the map itself was changed"


def _drive() -> tuple[Drive, Result]:
    """Return a drive and its map, which is a tenth of a metre off in the middle."""
    stamps = np.arange(float(NUM_SCANS))
    truth = np.column_stack((stamps, np.zeros((NUM_SCANS, 2))))
    events: list[SensorEvent] = [Odometry(stamp, stamp, IDENTITY) for stamp in stamps.tolist()]
    recording = cast(Recording, SimpleNamespace(stamps=stamps, true_poses=truth))
    drive = Drive("a drive", events, truth=recording)
    mapped = truth.copy()
    mapped[NUM_SCANS // 2, 1] += 0.1
    result = cast(Result, SimpleNamespace(stamps=stamps, trajectory=mapped))
    return drive, result


def test_a_run_begun_later_has_the_events_from_that_scan_on() -> None:
    drive, uncut = _drive()
    events = events_from(drive, uncut, 7)
    assert events == drive.events[7:]


def test_runs_begun_later_are_compared_by_common_scans(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is twice as wrong has twice the error, whatever it has left out."""
    drive, uncut = _drive()
    lengths = []

    def mapped(events: object) -> Result:
        first = NUM_SCANS - len(cast(list[SensorEvent], events))
        lengths.append(first)
        poses = uncut.trajectory[first:].copy()
        poses[:, 1] *= 2.0
        return cast(Result, SimpleNamespace(stamps=uncut.stamps[first:], trajectory=poses))

    monkeypatch.setattr("bench.session_chance.severed_trajectory", lambda *_: uncut.trajectory)
    row = chance_row({"case": "a drive"}, drive, uncut, mapped, 2)
    assert lengths == [round(LEFT_OUT * NUM_SCANS), round(2 * LEFT_OUT * NUM_SCANS)]
    for name in ("least", "mean", "largest"):
        assert row.figures[f"begun later, {name}"].value == pytest.approx(2.0, rel=0.01)
        assert row.figures[f"severed, {name}"].value == pytest.approx(1.0)


def test_a_drive_without_truth_has_no_chance() -> None:
    drive, uncut = _drive()
    row = chance_row({"case": "a drive"}, Drive("a drive", drive.events), uncut, lambda _: uncut, 1)
    assert not row.figures
    assert "neither" in row.notes
