# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from cartoloop.config import LifelongConfig, SubmapConfig
from cartoloop.lifelong.selection import select
from cartoloop.map_output.occupancy_map import UNKNOWN, compose_map
from cartoloop.submaps.finished_grid import FinishedGrid

SUBMAPS = SubmapConfig()
R = SUBMAPS.resolution
FREE, WALL = 20, 240
MISSED = 112
"""Value of a cell that one beam has passed."""


def floor(first_x, end_x, *, walls=(), size=40):
    """A grid that has seen the floor between two columns, with walls in some rows of cells."""
    cells = np.zeros((size, 2 * size), np.uint8)
    cells[:, first_x:end_x] = FREE
    for row, first, end in walls:
        cells[row, first:end] = WALL
    return FinishedGrid(cells, R / 2, R / 2, R)


def selected(*grids, sessions=None, poses=None, again=None, **limits):
    sessions = range(len(grids)) if sessions is None else sessions
    poses = np.zeros((len(grids), 3)) if poses is None else poses
    again = np.ones(len(grids), bool) if again is None else np.array(again)
    return select(grids, poses, np.array(sessions), again, SUBMAPS, LifelongConfig(**limits))


def test_a_submap_that_was_seen_again_is_removed():
    assert selected(floor(0, 40), floor(0, 40)).kept.tolist() == [False, True]


def test_a_submap_that_was_not_seen_again_stays():
    chosen = selected(floor(0, 40), floor(30, 70))
    assert chosen.kept.all()
    assert chosen.num_faded == 0


def test_a_submap_that_was_only_looked_into_stays():
    chosen = selected(floor(0, 40, walls=[(20, 10, 20)]), floor(0, 40), again=[False, True])
    assert chosen.kept.all()
    assert chosen.num_faded == 10


def test_submaps_of_one_session_do_not_remove_each_other():
    assert selected(floor(0, 40), floor(0, 40), floor(0, 40), sessions=[0, 1, 1]).kept.tolist() == [
        False, True, True,
    ]  # fmt: skip


def test_several_later_submaps_cover_one_together():
    chosen = selected(floor(0, 60), floor(0, 32), floor(28, 60), sessions=[0, 1, 1])
    assert chosen.kept.tolist() == [False, True, True]


def test_only_submaps_that_stay_cover_others():
    """The middle session covers the first, and is covered itself, but for a part."""
    first, second, third = floor(0, 20), floor(0, 70), floor(3, 70)
    assert selected(first, second, third).kept.tolist() == [False, False, True]
    assert selected(first, second, floor(40, 70)).kept.tolist() == [False, True, True]


def test_poses_are_taken_into_account():
    poses = np.array([(5.0, 2.0, 0.3), (5.0, 2.0, 0.3), (5.0, 20.0, 0.3)])
    chosen = selected(floor(0, 40), floor(0, 40), floor(0, 40), poses=poses)
    assert chosen.kept.tolist() == [False, True, True]


@pytest.mark.parametrize("value", [FREE, WALL])
def test_what_only_the_removed_one_saw_is_copied(value):
    old = floor(0, 42, walls=[(5, 40, 42)] if value == WALL else [])
    chosen = selected(old, floor(0, 40))
    assert chosen.kept.tolist() == [False, True]
    assert np.all(chosen.grids[1].cells[5, 40:42] == value)
    assert not chosen.grids[1].cells[:, 42:].any()


def test_what_one_has_passed_on_is_no_reason_to_keep_another():
    """Two thirds of the second were seen again; the rest is what the first one passes on."""
    chosen = selected(floor(0, 42), floor(36, 42), floor(0, 40), sessions=[0, 0, 1])
    assert chosen.kept.tolist() == [False, False, True]
    assert np.all(chosen.grids[2].cells[:, :42] == FREE)
    assert selected(floor(36, 42), floor(0, 40)).kept.all()


def test_selecting_again_removes_nothing_more():
    """Whatever the first selection left."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        starts = rng.integers(0, 50, 8)
        grids = [floor(start, start + rng.integers(8, 30)) for start in starts]
        sessions = np.sort(rng.integers(0, 2, 8))
        chosen = selected(*grids, sessions=sessions)
        left = np.flatnonzero(chosen.kept)
        again = selected(*(chosen.grids[i] for i in left), sessions=sessions[left])
        assert again.kept.all()


def test_what_was_seen_again_is_not_copied():
    old = floor(0, 40, walls=[(20, 10, 20)])
    chosen = selected(old, floor(0, 40))
    assert np.array_equal(chosen.grids[1].cells, floor(0, 40).cells)


def test_a_submap_stays_where_its_walls_would_be_lost():
    old = floor(0, 44, walls=[(5, 40, 44), (6, 40, 44), (9, 40, 44)])
    small = floor(0, 40)
    later = FinishedGrid(small.cells[:, :40], small.origin_x, small.origin_y, R)
    assert selected(old, later, max_growth=0.0).kept.all()
    limits = {"max_lost_wall": 1.0, "max_growth": 0.0}
    assert selected(old, later, **limits).kept.tolist() == [False, True]


def test_later_grids_grow_to_take_walls_just_outside():
    old = floor(0, 44, walls=[(5, 40, 44), (6, 40, 44), (9, 40, 44)])
    small = floor(0, 40)
    later = FinishedGrid(small.cells[:, :40], small.origin_x, small.origin_y, R)

    chosen = selected(old, later)

    assert chosen.kept.tolist() == [False, True]
    grown = chosen.grids[1]
    assert grown.shape == (40, 44)
    assert (grown.origin_x, grown.origin_y) == pytest.approx((R / 2, R / 2))
    assert np.array_equal(grown.cells, old.cells[:, :44])


def test_a_submap_with_walls_far_outside_stays():
    old = floor(0, 76, walls=[(5, 70, 76), (6, 70, 76), (9, 70, 76)])
    later = FinishedGrid(floor(0, 66).cells[:, :48], R / 2, R / 2, R)
    limits = {"min_covered_share": 0.5, "max_growth": 1.0}
    assert selected(old, later, **limits).kept.all()


def test_furniture_that_was_moved_fades():
    old = floor(0, 70, walls=[(20, 10, 30)])
    chosen = selected(old, floor(0, 40))
    assert chosen.kept.all()
    assert chosen.num_faded == 20
    occupancy = compose_map(chosen.grids, np.zeros((2, 3)), SUBMAPS)
    assert not np.any(occupancy.probability > 0.5)


def test_floor_where_furniture_was_put_fades():
    old, new = floor(0, 70), floor(0, 40, walls=[(5, 2, 30)])
    chosen = selected(old, new)
    assert not chosen.grids[0].cells[5, 2:30].any()
    assert np.all(chosen.grids[0].cells[5, 30:70] == FREE)


def test_what_stands_stays():
    walls = [(5, 2, 30)]
    chosen = selected(floor(0, 70, walls=walls), floor(0, 40, walls=walls))
    assert chosen.num_faded == 0
    assert np.array_equal(chosen.grids[0].cells, floor(0, 70, walls=walls).cells)


def glance(*columns, walls=()):
    """A grid of single beams along columns, with walls in some cells."""
    cells = np.zeros((40, 80), np.uint8)
    cells[:, list(columns)] = MISSED
    for cell in walls:
        cells[cell] = WALL
    return FinishedGrid(cells, R / 2, R / 2, R)


def test_a_single_beam_does_not_make_walls_fade():
    old = floor(0, 70, walls=[(20, 2, 30)])
    assert selected(old, glance(10), again=[False, True]).num_faded == 0
    assert selected(old, glance(10, 20), again=[False, True]).num_faded == 0


def test_neighbouring_beams_make_walls_fade():
    old = floor(0, 70, walls=[(20, 2, 30)])
    chosen = selected(old, glance(10, 11, 20), again=[False, True])
    assert np.flatnonzero(chosen.grids[0].cells[20] == 0)[:2].tolist() == [10, 11]
    assert chosen.num_faded == 2


def test_walls_that_beams_pass_on_one_side_stay():
    """Along a corridor, beams err by a cell or two, and seem to pass through its wall."""
    old = floor(0, 70, walls=[(20, 2, 70)])
    cells = floor(0, 70).cells.copy()
    cells[23:] = 0
    along = FinishedGrid(cells, R / 2, R / 2, R)
    chosen = selected(old, along, again=[False, True])
    assert chosen.num_faded == 0
    cells[:, 40:] = np.where(cells[:, 40:] > 0, MISSED, 0)
    assert selected(old, along, again=[False, True]).num_faded == 0


def test_a_wall_gives_way_to_one_beside_it():
    old = floor(0, 70, walls=[(20, 2, 70)])
    cells = floor(0, 70, walls=[(22, 2, 70)]).cells.copy()
    cells[23:] = 0
    chosen = selected(old, FinishedGrid(cells, R / 2, R / 2, R), again=[False, True])
    assert not chosen.grids[0].cells[20, 2:70].any()


def test_walls_that_are_hit_beside_the_beams_stay():
    old = floor(0, 70, walls=[(20, 2, 30)])
    beams = glance(10, 11, 12, walls=[(20, 9), (20, 14)])
    assert selected(old, beams, again=[False, True]).num_faded == 0


def test_a_glance_supersedes_nothing():
    old = floor(0, 40, walls=[(5, 30, 38)])
    cells = floor(0, 40).cells.copy()
    cells[:, 20:] = np.where(cells[:, 20:] > 0, 120, 0)  # hardly free
    cells[5, 30:38] = 0  # and not where the wall is
    chosen = selected(old, FinishedGrid(cells, R / 2, R / 2, R))
    before = compose_map([old], np.zeros((1, 3)), SUBMAPS).probability
    after = compose_map([chosen.grids[1]], np.zeros((1, 3)), SUBMAPS).probability
    assert chosen.kept.tolist() == [False, True]
    assert np.array_equal(after > 0.5, before > 0.5)
    assert np.array_equal(after >= 0, before >= 0)
    assert np.mean(after[(before >= 0) & (before < 0.196)] < 0.196) > 0.95


def test_evidence_of_several_removed_submaps_adds_up():
    weak = floor(0, 40)
    cells = np.where(weak.cells > 0, 80, 0).astype(np.uint8)
    glance = FinishedGrid(np.where(cells > 0, 125, 0).astype(np.uint8), R / 2, R / 2, R)
    old = [FinishedGrid(cells, R / 2, R / 2, R) for _ in range(3)]
    chosen = selected(*old, glance, sessions=[0, 0, 0, 1])
    together = compose_map([*old, glance], np.zeros((4, 3)), SUBMAPS).probability
    after = compose_map([chosen.grids[3]], np.zeros((1, 3)), SUBMAPS).probability
    assert chosen.kept.tolist() == [False, False, False, True]
    assert np.allclose(after, together, atol=0.01)


def test_walls_that_nobody_saw_again_stay_on_the_map():
    old = floor(0, 70, walls=[(5, 60, 70)])
    chosen = selected(old, floor(0, 40), floor(0, 40), floor(0, 30))
    probability = compose_map(chosen.grids, np.zeros((4, 3)), SUBMAPS).probability
    assert np.count_nonzero(probability > 0.5) >= 10
    assert np.count_nonzero(probability > UNKNOWN) >= 40 * 70


def test_nothing_and_empty_grids_are_selected_from():
    assert len(selected().kept) == 0
    empty = FinishedGrid(np.zeros((0, 0), np.uint8), 0.0, 0.0, R)
    assert selected(empty, floor(0, 40), empty).kept[-1]
