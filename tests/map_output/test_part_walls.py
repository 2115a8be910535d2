# SPDX-License-Identifier: Apache-2.0
"""Walls of one part of a map that another part saw through."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import JoinConfig, SubmapConfig
from cartoloop.map_output.part_walls import Submaps, wall_faults
from cartoloop.sensor.pose import Pose, transform_points
from cartoloop.submaps.finished_grid import FinishedGrid

UNSEEN, FLOOR, WALL = 0, 1, 255
RESOLUTION, WIDTH = 0.05, 44
"""A corridor 2.2 m wide."""

JOIN, SUBMAPS = JoinConfig(), SubmapConfig()
LIMITS = (JOIN.max_contradicted_wall, JOIN.min_hidden_area, np.zeros((0, 2)))


def corridor(length, end_at=None, blocks=()):
    """Return a submap of a corridor along x; it ends at a wall if `end_at` is given [cells]."""
    cells = np.full((WIDTH + 20, length), UNSEEN, np.uint8)
    inside = slice(10, 10 + WIDTH)
    seen = length if end_at is None else end_at
    cells[inside, :seen] = FLOOR
    cells[10, :seen] = cells[9 + WIDTH, :seen] = WALL
    if end_at is not None:
        cells[inside, end_at - 2 : end_at] = WALL
    for rows, cols in blocks:
        cells[rows, cols] = WALL
    return Submaps([FinishedGrid(cells, 0.0, 0.0, RESOLUTION)], np.zeros((1, 3)))


def test_same_corridor_does_not_contradict_itself():
    assert wall_faults(corridor(200), corridor(200), SUBMAPS, *LIMITS) == []


def test_corridor_that_goes_on_contradicts_its_end():
    for one, other in ((0, 1), (1, 0)):
        parts = (corridor(200, end_at=100), corridor(200))
        (fault,) = wall_faults(parts[one], parts[other], SUBMAPS, *LIMITS)
        assert fault.x == pytest.approx(5.0, abs=0.2)
        assert fault.length > 1.2
        assert fault.hidden > 5.0
        assert fault.closes


@pytest.mark.parametrize(("x", "is_fault"), [(3.0, True), (-25.0, False)])
def test_walls_far_from_what_holds_may_be_displaced(x, is_fault):
    # The end of the corridor is seen half a metre further away.
    end, further = (
        corridor(200, end_at=100),
        corridor(200, blocks=[(slice(10, 40), slice(110, 112))]),
    )
    held = np.array([(x, 1.0), (x - 10.0, 1.0)])
    faults = wall_faults(end, further, SUBMAPS, *LIMITS[:2], held)
    assert bool(faults) is is_fault


def slanted(slope, further):
    """Return a corridor with a wall across that is further away than 5 m, and oblique [cells].

    One sees past it.
    """
    rows = np.arange(10, 40)
    cols = 98 + further + np.rint(slope * (rows - rows.mean())).astype(np.int64)
    return corridor(200, blocks=[(rows, cols), (rows, cols + 1)])


@pytest.mark.parametrize(("further", "is_fault"), [(9, False), (10, False), (13, True)])
def test_walls_are_displaced_by_so_much_only(further, is_fault):
    # 20 m away: half a metre are allowed, between cells of the same side of the wall.
    held = np.array([(-15.0, 1.0)])
    parts = corridor(200, end_at=100), slanted(0.0, further)
    assert bool(wall_faults(*parts, SUBMAPS, *LIMITS[:2], held)) is is_fault


@pytest.mark.parametrize(("slope", "is_fault"), [(0.0, False), (0.05, False), (0.25, True)])
def test_displaced_walls_are_parallel(slope, is_fault):
    held = np.array([(-25.0, 1.0)])
    parts = corridor(200, end_at=100), slanted(slope, 10)
    assert bool(wall_faults(*parts, SUBMAPS, *LIMITS[:2], held)) is is_fault


def test_corridor_that_goes_on_contradicts_from_afar():
    held = np.array([(-25.0, 1.0)])
    assert wall_faults(corridor(200, end_at=100), corridor(200), SUBMAPS, *LIMITS[:2], held)


def test_furniture_that_was_moved_does_not_contradict():
    cupboard = (slice(30, 32), slice(80, 110))
    parts = corridor(200), corridor(200, blocks=[cupboard])
    assert wall_faults(*parts, SUBMAPS, *LIMITS) == []


def test_a_shelf_before_a_wall_hides_no_other_room():
    """The room behind the wall is hidden by the wall, in both parts."""
    wall = (slice(10, 10 + WIDTH), slice(108, 110))
    parts = corridor(200, end_at=100), corridor(200, blocks=[wall])
    assert wall_faults(*parts, SUBMAPS, *LIMITS) == []


@pytest.mark.parametrize(("hidden", "is_fault"), [(30, False), (70, True)])
def test_a_row_of_shelves_hides_little_for_its_length(hidden, is_fault):
    """Shelves of 3 m hide 1.5 m up to the wall behind them, a wall of 3 m a room."""
    cells = np.full((HALL, HALL), FLOOR, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = WALL
    cells[0:60, 20 : 20 + hidden + 2] = UNSEEN
    cells[0:60, 20:22] = WALL
    shelves = Submaps([FinishedGrid(cells, 0.0, 0.0, RESOLUTION)], np.zeros((1, 3)))
    assert bool(wall_faults(shelves, hall(), SUBMAPS, *LIMITS)) is is_fault


@pytest.mark.parametrize(("depth", "is_fault"), [(10, False), (60, True)])
def test_what_lies_before_a_wall_is_not_hidden_by_it(depth, is_fault):
    """Behind a shelf lies a strip, behind a wall a room; what lies before counts for neither."""
    wall_behind = (slice(20, HALL), slice(52 + depth, 54 + depth))
    behind, before = (slice(40, HALL), slice(52, 52 + depth)), (slice(70, HALL), slice(12, 52))
    cells, other = (hall().grids[0].cells.copy() for _ in range(2))
    cells[20:40, 40 : 52 + depth] = cells[behind] = cells[before] = UNSEEN
    cells[40:70, 50:52] = WALL
    cells[wall_behind] = other[wall_behind] = WALL
    parts = (
        Submaps([FinishedGrid(each, 0.0, 0.0, RESOLUTION)], np.zeros((1, 3)))
        for each in (cells, other)
    )
    assert bool(wall_faults(*parts, SUBMAPS, *LIMITS)) is is_fault


@pytest.mark.parametrize("turned", [0, 1, 2, 3])
@pytest.mark.parametrize("is_mirrored", [False, True])
def test_both_sides_of_a_wall_known_from_both_count(turned, is_mirrored):
    cells, other = corridor(200, end_at=100).grids[0].cells.copy(), corridor(200).grids[0].cells
    cells[10 : 10 + WIDTH, 100:105] = FLOOR
    parts = []
    for each in (cells, other):
        placed = np.rot90(each[:, ::-1] if is_mirrored else each, turned).copy()
        parts.append(Submaps([FinishedGrid(placed, 0.0, 0.0, RESOLUTION)], np.zeros((1, 3))))
    (fault,) = wall_faults(*parts, SUBMAPS, *LIMITS)
    assert fault.hidden > 5.0


def test_what_begins_before_a_shelf_is_not_hidden_by_it():
    """What something else hides crosses the line of the shelf metres away."""
    hidden, other = (np.full((160, 160), FLOOR, np.uint8) for _ in range(2))
    for cells in (hidden, other):
        cells[[0, -1]] = cells[:, [0, -1]] = WALL
        cells[1:120, 59:61] = WALL
    hidden[20:70, 50:52] = WALL
    hidden[20:70, 52:59] = hidden[75:160, 5:48] = hidden[122:160, 5:160] = UNSEEN
    parts = (
        Submaps([FinishedGrid(cells, 0.0, 0.0, RESOLUTION)], np.zeros((1, 3)))
        for cells in (hidden, other)
    )
    assert wall_faults(*parts, SUBMAPS, *LIMITS) == []


HALL = 120
"""Edge of a hall of 6 m [cells]."""


def hall(*cupboards):
    """Return a hall; behind a cupboard, as seen from the left, and beyond its far end is nothing.

    Parameters
    ----------
    cupboards : first and last row of the front of each, and the row up to which it hides the rest.
    """
    cells = np.full((HALL, HALL), FLOOR, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = WALL
    for first, last, hidden in cupboards:
        cells[first:hidden, 52:] = UNSEEN
        cells[first:last, 50:52] = WALL
    return Submaps([FinishedGrid(cells, 0.0, 0.0, RESOLUTION)], np.zeros((1, 3)))


@pytest.mark.parametrize("turn", [0.0, 0.6, 1.5707963])
def test_cupboard_that_hides_a_room_does_not_contradict(turn):
    # 1.5 m: longer than a door; but one sees past its upper end.
    poses = np.array([(3.0, -1.0, turn)])
    seen_past = Submaps(hall((40, 70, 70)).grids, poses)
    seen_past_one_end = Submaps(hall((40, 70, HALL)).grids, poses)
    for cupboard in (seen_past, seen_past_one_end):
        assert wall_faults(cupboard, Submaps(hall().grids, poses), SUBMAPS, *LIMITS) == []


@pytest.mark.parametrize("turn", [0.0, 0.6, 1.5707963])
def test_wall_that_nobody_saw_past_contradicts(turn):
    poses = np.array([(3.0, -1.0, turn)])
    cells = hall((40, 70, HALL)).grids[0].cells.copy()
    cells[:40, 50:] = cells[70:, 50:] = UNSEEN
    blocked = Submaps([FinishedGrid(cells, 0.0, 0.0, RESOLUTION)], poses)
    (fault,) = wall_faults(blocked, Submaps(hall().grids, poses), SUBMAPS, *LIMITS)
    assert fault.length == pytest.approx(1.5, abs=0.2)
    assert not fault.closes
    # Where a robot drove, furniture is hardly ever put.
    through = np.column_stack((np.linspace(1.0, 4.0, 16), np.full(16, 2.7)))
    driven = Submaps(hall().grids, poses, transform_points(Pose(*poses[0].tolist()), through))
    (fault,) = wall_faults(blocked, driven, SUBMAPS, *LIMITS)
    assert fault.closes


def test_wall_of_more_than_furniture_contradicts():
    # 2.5 m: one sees past it, as past the corner of a corridor.
    (fault,) = wall_faults(hall((40, 90, HALL)), hall(), SUBMAPS, *LIMITS)
    assert fault.length == pytest.approx(2.5, abs=0.2)


@pytest.mark.parametrize(("last", "closes"), [(90, False), (116, True)])
def test_only_long_walls_close_what_they_do_not_span(last, closes):
    # 2.5 and 3.8 m, in the middle of a hall.
    (fault,) = wall_faults(hall((40, last, HALL)), hall(), SUBMAPS, *LIMITS)
    assert fault.closes is closes


def test_wall_that_goes_on_is_no_furniture():
    # The other part has an opening of 2 m in a wall of 3 m, which ends in the middle of the hall.
    wall, opened = (hall((60, HALL, HALL)) for _ in range(2))
    cells = opened.grids[0].cells.copy()
    cells[70:110, 50:] = FLOOR
    cells[70:110, -1] = WALL
    opened = Submaps([FinishedGrid(cells, 0.0, 0.0, RESOLUTION)], opened.poses)
    (fault,) = wall_faults(wall, opened, SUBMAPS, *LIMITS)
    assert 1.2 <= fault.length < 1.7


def test_door_that_was_closed_does_not_contradict():
    # It hides the rest of the corridor, but is 0.9 m wide.
    closed = corridor(200, end_at=100)
    opened = corridor(200)
    cells = opened.grids[0].cells.copy()
    cells[10:28, 98:100] = cells[46:54, 98:100] = WALL
    opened = Submaps([FinishedGrid(cells, 0.0, 0.0, RESOLUTION)], opened.poses)
    assert wall_faults(closed, opened, SUBMAPS, *LIMITS) == []


def test_beams_through_a_window_do_not_contradict():
    # The end of the corridor is of glass to the other part: it sees floor behind, but no wall.
    closed, opened = corridor(200, end_at=100), corridor(200)
    cells = opened.grids[0].cells.copy()
    cells[10, 100:] = cells[9 + WIDTH, 100:] = UNSEEN
    opened = Submaps([FinishedGrid(cells, 0.0, 0.0, RESOLUTION)], opened.poses)
    assert wall_faults(closed, opened, SUBMAPS, *LIMITS) == []


def test_ragged_edge_does_not_contradict():
    # What is seen through a gap ends anywhere.
    ends = np.random.default_rng(1).integers(85, 100, WIDTH)
    ragged = corridor(200)
    cells = ragged.grids[0].cells.copy()
    for row, end in enumerate(ends, start=10):
        cells[row, end:] = UNSEEN
        cells[row, end] = WALL
    ragged = Submaps([FinishedGrid(cells, 0.0, 0.0, RESOLUTION)], ragged.poses)
    assert wall_faults(ragged, corridor(200), SUBMAPS, *LIMITS) == []


def test_slanted_wall_contradicts():
    slanted = corridor(200)
    cells = slanted.grids[0].cells.copy()
    for row in range(10, 10 + WIDTH):
        cells[row, 80 + row :] = UNSEEN
        cells[row, 79 + row : 81 + row] = WALL
    slanted = Submaps([FinishedGrid(cells, 0.0, 0.0, RESOLUTION)], slanted.poses)
    (fault,) = wall_faults(slanted, corridor(200), SUBMAPS, *LIMITS)
    # Of 3.1 m, without its ends: they are near walls of the other part.
    assert fault.length == pytest.approx(2.3, abs=0.2)


def test_parts_that_do_not_overlap_do_not_contradict():
    far = Submaps(corridor(200).grids, np.array([(100.0, 0.0, 0.0)]))
    assert wall_faults(corridor(200, end_at=100), far, SUBMAPS, *LIMITS) == []


def test_part_without_cells_does_not_contradict():
    nothing = Submaps([], np.zeros((0, 3)))
    assert wall_faults(corridor(200), nothing, SUBMAPS, *LIMITS) == []
