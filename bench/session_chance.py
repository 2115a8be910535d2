# SPDX-License-Identifier: Apache-2.0
"""How much of a ratio of errors is chance: the uncut run begun later, and severed where it is cut.

The error of a large map is that of a few bends of its whole. Other submaps, whose pixels lie
elsewhere, bend it in another way. So the same recording is mapped without its first scans. And
its map is adjusted again without what connects submaps across the cuts, which sessions lack.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy

import numpy as np

from bench.record import Case, Figure, Row
from bench.session_measures import Drive, error
from cartoloop.arrays import FloatArray
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.global_slam.trajectory import optimized_trajectory
from cartoloop.result import Result
from cartoloop.sensor.events import SensorEvent

SEVERED_INTO = (2, 5, 10)
"""Numbers of sessions."""

LEFT_OUT = 0.01
"""Share of the scans that are left out at the beginning; twice as many the next time, and so on."""


def chance_row(
    case: Case,
    drive: Drive,
    uncut: Result,
    mapped: Callable[[Sequence[SensorEvent]], Result],
    num_later: int,
) -> Row:
    """Return the errors of an uncut run begun later, and severed, over its own.

    Parameters
    ----------
    mapped : makes the map of events.
    num_later : how often it is begun later.
    """
    whole = error(drive, uncut.stamps, uncut.trajectory)
    if whole is None:
        return Row(case, notes="neither relations nor the truth are known")
    figures = {"uncut": Figure.exact(whole, "m", better=None)}
    later = []
    for number in range(1, num_later + 1):
        begun = mapped(events_from(drive, uncut, round(number * LEFT_OUT * len(uncut.stamps))))
        later.append(_ratio(drive, uncut, begun.stamps, begun.trajectory))
    severed = [
        _ratio(drive, uncut, uncut.stamps, severed_trajectory(uncut, count))
        for count in SEVERED_INTO
    ]
    for name, ratios in (("begun later", later), ("severed", severed)):
        if ratios:
            figures[f"{name}, least"] = Figure.exact(min(ratios), better=None)
            figures[f"{name}, mean"] = Figure.exact(float(np.mean(ratios)), better=None)
            figures[f"{name}, largest"] = Figure.exact(max(ratios), better=None)
    return Row(case, figures)


def events_from(drive: Drive, uncut: Result, scan: int) -> list[SensorEvent]:
    """Return the events of a drive from a scan of its map on."""
    begin = uncut.stamps[scan]
    stamps = [event.stamp for event in drive.events]
    return drive.events[stamps.index(begin) :]


def _ratio(drive: Drive, uncut: Result, stamps: FloatArray, poses: FloatArray) -> float:
    """Return the error of scans over what it is in the uncut run, of those that both have."""
    ours, theirs = np.isin(stamps, uncut.stamps), np.isin(uncut.stamps, stamps)
    found = error(drive, stamps[ours], poses[ours])
    before = error(drive, uncut.stamps[theirs], uncut.trajectory[theirs])
    assert found is not None and before is not None
    return found / before


def severed_trajectory(uncut: Result, count: int) -> FloatArray:
    """Return the poses of scans without the chain of submaps across cuts, with all loop closures.

    Parameters
    ----------
    count : sessions, of the same number of scans.
    """
    graph = deepcopy(uncut.graph)
    is_chain = graph.kinds == ConstraintKind.INTRA_SUBMAP
    submaps, nodes = graph.index_a[is_chain], graph.index_b[is_chain]
    first_nodes = np.full(graph.num_submaps, graph.num_nodes)
    np.minimum.at(first_nodes, submaps, nodes)
    sessions = uncut.node_scan_index * count // len(uncut.stamps)
    is_across = np.zeros(len(is_chain), dtype=np.bool_)
    is_across[is_chain] = sessions[first_nodes[submaps]] != sessions[nodes]
    graph.remove(is_across)
    config = uncut.config.global_slam.pose_adjustment
    adjust(
        graph,
        AdjustmentOptions(
            loss=config.loss,
            loss_scale=config.loss_scale,
            max_iterations=config.max_num_final_iterations,
        ),
    )
    return optimized_trajectory(uncut.local_trajectory, uncut.node_scan_index, graph.node_poses)
