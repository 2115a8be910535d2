# SPDX-License-Identifier: Apache-2.0
"""A corridor driven through again and again, with furniture that is moved in between."""

import numpy as np
import pytest

from cartoloop.config import LifelongConfig, SubmapConfig
from cartoloop.lifelong.selection import select
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.submaps.finished_grid import FinishedGrid

SUBMAPS = SubmapConfig()
R = SUBMAPS.resolution
FREE, WALL = 20, 240
LENGTH, WIDTH = 240, 40
"""Of the corridor [cells], with a wall along each side."""

NUM_DRIVES = 20


def corridor(begin, end, box):
    """What a submap sees of the corridor between two columns, and of a box in it."""
    cells = np.zeros((WIDTH, end - begin), np.uint8)
    cells[1:-1] = FREE
    cells[[0, -1]] = WALL
    for column in range(max(box, begin), min(box + 4, end)):
        cells[18:22, column - begin] = WALL
    return FinishedGrid(cells, R / 2 + R * begin, R / 2, R)


def drive(number, rng):
    """The submaps of a drive; it ends somewhere else each time, and its poses are a bit wrong."""
    first, end = (int(cell) for cell in rng.integers((0, LENGTH - 50), (50, LENGTH + 1)))
    begins = range(first, end - 30, 40)
    grids = [corridor(begin, min(begin + 60, end), box_place(number)) for begin in begins]
    return grids, rng.normal(0.0, (0.01, 0.01, 0.0005), (len(grids), 3))


def box_place(number):
    return 60 + 6 * number


@pytest.fixture(scope="module", params=[1, 2, 3])
def history(request):
    """What is left after each drive: grids and their poses."""
    rng = np.random.default_rng(request.param)
    grids, poses, sessions = [], np.zeros((0, 3)), np.zeros(0, np.int64)
    left = []
    for number in range(NUM_DRIVES):
        new, new_poses = drive(number, rng)
        grids, poses = [*grids, *new], np.concatenate((poses, new_poses))
        sessions = np.concatenate((sessions, np.full(len(new), number)))
        chosen = select(
            grids, poses, sessions, np.ones(len(grids), bool), SUBMAPS, LifelongConfig()
        )
        grids = [grid for grid, kept in zip(chosen.grids, chosen.kept, strict=True) if kept]
        poses, sessions = poses[chosen.kept], sessions[chosen.kept]
        left.append((grids, poses))
    return left


def test_submaps_and_cells_are_bounded_by_the_area(history):
    """No more than twice those of one drive through all of it, however often."""
    whole = [corridor(begin, begin + 60, 0) for begin in range(0, LENGTH - 59, 40)]
    num_cells = sum(grid.cells.size for grid in whole)
    for grids, _ in history:
        assert len(grids) <= 2 * len(whole)
        assert sum(grid.cells.size for grid in grids) <= 2 * num_cells


def test_a_wall_is_not_thickened_by_copies(history):
    for grids, poses in (history[2], history[-1]):
        occupancy = compose_map(grids, poses, SUBMAPS)
        walls = (occupancy.probability > 0.5).sum(axis=0)
        assert np.median(walls[walls > 0]) <= 4  # two walls, each on the edge of a cell at most


def test_only_the_box_of_the_last_drive_is_left(history):
    occupancy = compose_map(*history[-1], SUBMAPS)
    row, col = (round(-origin / R) for origin in (occupancy.origin_y, occupancy.origin_x))
    is_wall = occupancy.probability[row + 16 : row + 24] > 0.5
    walls = np.flatnonzero(is_wall.any(axis=0)) - col
    last = box_place(NUM_DRIVES - 1)
    assert len(walls) >= 4
    assert np.all((walls >= last - 2) & (walls < last + 6))
