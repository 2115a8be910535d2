# SPDX-License-Identifier: Apache-2.0
from itertools import pairwise
from pathlib import Path

import pytest

from bench.growth import Checkpoint, grow
from bench.scaling import _part, _whole
from cartoloop.simulation import make_world, simulate

pytestmark = pytest.mark.slow


def test_checkpoints_end_with_the_finished_map(tmp_path: Path) -> None:
    log = tmp_path / "office.log"
    simulate(make_world("office"), duration=20.0).write_carmen(log)
    points = grow(log, 4)
    assert [point.scans for point in points] == [0, 25, 50, 75, 100, 101]
    assert [point.is_finished for point in points] == [False] * 5 + [True]
    assert all(
        before.cpu_s <= after.cpu_s and before.nodes <= after.nodes
        for before, after in pairwise(points)
    )
    part = _part("0 to 1", [(points[0], points[1])]).figures
    assert part["CPU a node"].value == 1e3 * part["CPU"].value / points[1].nodes
    assert _whole([points[-1]], 20.0).figures["times real time"].value == 20.0 / points[-1].wall_s


def test_repeated_runs_give_a_median_and_a_spread() -> None:
    start = Checkpoint(0, 0, 0, 0.0, 0.0, 100.0)
    ends = [Checkpoint(90, 50, 3, 2.0 * cpu, cpu, 100.0 + cpu) for cpu in (1.0, 2.0, 3.0)]
    figures = _part("0 to 1", [(start, end) for end in ends]).figures
    assert (figures["CPU"].value, figures["CPU"].repeats) == (2.0, 3)
    assert figures["CPU"].low == 1.2
    assert figures["CPU a node"].value == 40.0
    assert _whole(ends, 8.0).figures["times real time"].value == 2.0
