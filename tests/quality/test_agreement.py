# SPDX-License-Identifier: Apache-2.0
"""Floor that only beams without a return have cleared, of a scanner that sees less far."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.kernels.map_agreement import CellGrid
from cartoloop.quality.agreement import agreement, farthest_return, sure_floor
from cartoloop.quality.pairs import FLOOR, agreement_limits, cell_value
from cartoloop.sensor.scan_points import ScanPoints

LIMITS = agreement_limits(0.05, 10.0)
AT_ORIGIN = np.zeros((1, 3))


def cleared(radius):
    """Return a submap of nothing but floor around the origin, up to a radius [m]."""
    rows, cols = np.mgrid[-160:161, -160:161]
    is_floor = np.hypot(rows, cols) * 0.05 <= radius
    cells = np.where(is_floor, cell_value(FLOOR) - 1, 0).astype(np.uint8)
    return CellGrid(cells, -8.0, -8.0, 0.05)


def wall(distance, num=20):
    """Return a scan of a wall ahead of the robot."""
    return ScanPoints.of([np.column_stack((np.full(num, distance), np.linspace(-0.5, 0.5, num)))])


def on_floor(grid, scan):
    """Return how many returns of a scan at the origin are on floor."""
    return int(agreement(grid, LIMITS, scan, AT_ORIGIN)[0, 1])


@pytest.mark.parametrize("kind", ["of_visits", "consecutive"])
def test_returns_at_own_ones_do_not_contradict(kind):
    own, grid = wall(2.5), cleared(5.0)

    floor = getattr(sure_floor(grid, LIMITS, own, AT_ORIGIN, farthest_return(own)), kind)

    assert on_floor(grid, own) == 20
    assert on_floor(floor, own) == 0
    assert on_floor(floor, wall(2.55)) == 0
    assert on_floor(floor, wall(2.0)) == 20


def test_consecutive_scans_do_not_contradict_out_of_reach():
    own = wall(2.5)

    floor = sure_floor(cleared(5.0), LIMITS, own, AT_ORIGIN, 3.0)

    assert on_floor(floor.of_visits, wall(4.0)) == 20
    assert on_floor(floor.consecutive, wall(4.0)) == 0
    assert on_floor(floor.consecutive, wall(2.0)) == 20


def test_the_reach_is_that_from_the_nearest_scan():
    grid, poses = cleared(5.0), np.array(((0.0, 0.0, 0.0), (2.0, 0.0, 0.0)))
    own = ScanPoints.of([wall(2.5)[0], wall(2.5)[0]])

    floor = sure_floor(grid, LIMITS, own, poses, 3.0)

    assert on_floor(floor.consecutive, wall(4.0)) == 20


@pytest.mark.parametrize("reach", [5.1, 30.0])
def test_floor_within_the_reach_of_a_scanner_is_sure(reach):
    grid, own = cleared(5.0), wall(2.5)

    floor = sure_floor(grid, LIMITS, own, AT_ORIGIN, reach)

    assert on_floor(floor.of_visits, own) == on_floor(floor.consecutive, own) == 20


def test_walls_near_own_returns_remain():
    grid, own = cleared(5.0), wall(2.5)
    grid.cells[150:171, 210] = 255

    floor = sure_floor(grid, LIMITS, own, AT_ORIGIN, 3.0)

    for cells in floor:
        assert agreement(cells, LIMITS, own, AT_ORIGIN)[0, 0] == 20


def test_the_farthest_return_is_that_of_all_scans():
    assert farthest_return(ScanPoints.of([wall(2.0)[0], wall(4.0, 1)[0]])) == pytest.approx(
        4.03, 0.01
    )
    assert farthest_return(ScanPoints.of([np.empty((0, 2))])) == 0.0
