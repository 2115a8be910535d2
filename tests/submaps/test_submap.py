# SPDX-License-Identifier: Apache-2.0
"""The two active submaps: when they begin and end, where they stand, what they receive."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import SubmapConfig
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.range_noise import NO_NOISE, Noise
from cartoloop.submaps.finished_grid import MAX_PROBABILITY, MIN_PROBABILITY
from cartoloop.submaps.probability_grid import (
    ProbabilityGrid,
    cells_with_walls,
    insert_cells,
)
from cartoloop.submaps.submap import MAX_WEIGHT, ActiveSubmaps

RESOLUTION = 0.1
NO_POINTS = np.zeros((0, 2))
num_range_data = pytest.mark.parametrize("num_range_data", [1, 2, 5])


def config(num_range_data):
    return SubmapConfig(resolution=RESOLUTION, num_range_data=num_range_data)


def drive(num_range_data, num_scans):
    """Insert scans along a line; return the active submaps and what each insertion did."""
    active = ActiveSubmaps(config(num_range_data))
    insertions = []
    for k in range(num_scans):
        at = Pose(0.17 * k, -0.09 * k, 0.1 * k)
        ends = np.array([(at.x + 1.0, at.y), (at.x, at.y + 1.0)])
        insertions.append(active.insert(at, ends, NO_POINTS))
    return active, insertions


def indices(insertion):
    return [submap.index for submap in insertion.submaps]


@num_range_data
def test_a_submap_starts_every_num_range_data_scans(num_range_data):
    _, insertions = drive(num_range_data, 6 * num_range_data)
    first_seen = {}
    for k, insertion in enumerate(insertions):
        for index in indices(insertion):
            first_seen.setdefault(index, k)
    assert first_seen == {n: n * num_range_data for n in range(6)}


@num_range_data
def test_a_submap_is_finished_after_twice_num_range_data(num_range_data):
    _, insertions = drive(num_range_data, 6 * num_range_data)
    finished = {
        insertion.finished.index: k for k, insertion in enumerate(insertions) if insertion.finished
    }
    assert finished == {n: (n + 2) * num_range_data - 1 for n in range(5)}
    for insertion in insertions:
        if insertion.finished:
            assert insertion.finished is insertion.submaps[0]
            assert insertion.finished.num_scans == 2 * num_range_data


@num_range_data
def test_two_submaps_overlap_after_the_first_scans(num_range_data):
    _, insertions = drive(num_range_data, 6 * num_range_data)
    for k, insertion in enumerate(insertions):
        newest = k // num_range_data
        assert indices(insertion) == ([0] if newest == 0 else [newest - 1, newest])


@num_range_data
def test_the_older_submap_is_at_least_half_full(num_range_data):
    active = ActiveSubmaps(config(num_range_data))
    assert active.submaps == ()
    for k in range(5 * num_range_data):
        active.insert(Pose(0.0, 0.0, 0.0), NO_POINTS, NO_POINTS)
        assert active.submaps[0].num_scans >= min(k + 1, num_range_data)


def test_a_finished_submap_does_not_change():
    active, insertions = drive(2, 4)
    done = insertions[-1].finished
    before = done.grid.cells.copy()
    active.insert(Pose(0.0, 0.0, 0.0), np.array([(1.0, 0.0)]), NO_POINTS)
    assert np.array_equal(done.grid.cells, before)
    assert done.num_scans == 4
    assert done not in active.submaps


places = st.floats(-50.0, 50.0)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.builds(Pose, places, places, places), min_size=2, max_size=5))
def test_the_lattices_of_all_submaps_coincide(poses):
    active = ActiveSubmaps(config(1))
    for pose in poses:
        for submap in active.insert(pose, NO_POINTS, NO_POINTS).submaps:
            x, y, theta = submap.tf_local_submap
            assert theta == 0.0
            for coordinate in (x, y):
                cells = coordinate / RESOLUTION
                assert cells == pytest.approx(round(cells), abs=1e-6)


@settings(deadline=None, max_examples=40)
@given(st.builds(Pose, places, places, places))
def test_a_submap_starts_at_the_grid_point_near_the_sensor(pose):
    (submap,) = ActiveSubmaps(config(3)).insert(pose, NO_POINTS, NO_POINTS).submaps
    half = 0.5 * RESOLUTION + 1e-9
    assert abs(submap.tf_local_submap.x - pose.x) <= half
    assert abs(submap.tf_local_submap.y - pose.y) <= half


def test_all_submaps_show_the_same_world():
    sensor, config_ = Pose(3.02, -7.41, 0.3), config(1)
    angles = np.linspace(0.0, math.tau, 90)
    ends = np.array(sensor[:2]) + 2.0 * np.column_stack((np.cos(angles), np.sin(angles)))
    active = ActiveSubmaps(config_)
    active.insert(Pose(0.0, 0.0, 0.0), NO_POINTS, NO_POINTS)  # begins the older elsewhere
    insertion = active.insert(sensor, ends, NO_POINTS)
    in_local = ProbabilityGrid(RESOLUTION)
    cells = cells_with_walls(sensor, ends, NO_POINTS, config_, are_hidden=True)
    insert_cells(in_local, cells, config_, weight=MAX_WEIGHT)  # it is far from the first
    expected = in_local.finish()

    assert len(insertion.submaps) == 2
    for submap in insertion.submaps:
        shown = submap.grid.finish()
        assert np.array_equal(shown.cells, expected.cells)
        assert shown.origin_x + submap.tf_local_submap.x == pytest.approx(expected.origin_x)
        assert shown.origin_y + submap.tf_local_submap.y == pytest.approx(expected.origin_y)


@pytest.mark.parametrize(("noise_cells", "offset_cells"), [(0.2, 0.0), (0.4, 0.5), (0.6, 0.0)])
def test_noise_does_not_move_a_wall(noise_cells, offset_cells):
    """Other scans miss what is hit in front of it, and what is hit behind it is hidden."""
    active, rng = ActiveSubmaps(config(200)), np.random.default_rng(0)
    wall_x = 2.0 + offset_cells * RESOLUTION
    angles = np.radians(np.arange(-70.0, 70.0, 0.5))
    beams = np.column_stack((np.cos(angles), np.sin(angles)))
    for _ in range(60):
        noise = noise_cells * RESOLUTION * rng.standard_normal(len(angles))
        ranges = wall_x / np.cos(angles) + noise
        active.insert(Pose(0.0, 0.0, 0.0), ranges[:, np.newaxis] * beams, NO_POINTS)
    grid = active.submaps[0].grid
    rows = np.arange(-round(0.5 / RESOLUTION), round(0.5 / RESOLUTION)) - grid.first_row
    around = np.arange(-3, 4)
    columns = round(2.0 / RESOLUTION) + around - grid.first_col
    profile = grid.cells[np.ix_(rows, columns)].clip(MIN_PROBABILITY).mean(axis=0)
    weights = profile - MIN_PROBABILITY
    assert weights @ around / weights.sum() == pytest.approx(offset_cells, abs=0.05)


def test_a_coarse_scan_hits_the_wall_between_its_beams():
    """A later scan, from another angle, finds there what it returns from."""
    active = ActiveSubmaps(config(5))
    returns = np.array([(2.0, 0.3 * k) for k in range(-4, 5)])
    active.insert(Pose(0.0, 0.0, 0.0), returns, NO_POINTS)
    grid = active.submaps[0].grid
    column = round(2.0 / RESOLUTION) - grid.first_col
    rows = np.arange(round(-0.9 / RESOLUTION), round(0.9 / RESOLUTION) + 1) - grid.first_row
    assert (grid.cells[rows, column] > 0.5).all()


def test_walls_stay_open_where_gaps_are_not_closed():
    open_ = SubmapConfig(resolution=RESOLUTION, max_return_gap=0.0)
    active = ActiveSubmaps(open_)
    returns = np.array([(2.0, 0.3 * k) for k in range(-4, 5)])
    active.insert(Pose(0.0, 0.0, 0.0), returns, NO_POINTS)
    assert np.count_nonzero(active.submaps[0].grid.cells > 0.5) == len(returns)


@pytest.mark.parametrize(("num_scans", "before"), [(3, [0]), (8, [0, 1]), (13, [1, 2])])
def test_starting_over_ends_all_submaps_in_turn(num_scans, before):
    active, _ = drive(5, num_scans)
    assert [submap.index for submap in active.submaps] == before
    counts = {submap.index: submap.num_scans for submap in active.submaps}
    far, ends = Pose(30.0, 0.0, 0.0), np.array([(31.0, 0.0)])
    first = active.insert(far, ends, NO_POINTS, starts_over=True)
    new = before[-1] + 1
    assert indices(first) == [before[-1], new]
    assert [submap.index for submap in active.submaps] == [new]
    finished = [first.finished]
    for _ in range(4):
        later = active.insert(far, ends, NO_POINTS)
        assert indices(later) == [new]
        finished.append(later.finished)
    assert [submap.index for submap in finished if submap] == before
    assert all(submap.num_scans == counts[submap.index] for submap in finished if submap)


def test_submaps_that_wait_to_be_finished_are_unfinished():
    active, _ = drive(5, 8)
    active.insert(Pose(30.0, 0.0, 0.0), np.array([(31.0, 0.0)]), NO_POINTS, starts_over=True)
    assert [submap.index for submap in active.unfinished] == [1, 2]
    active.insert(Pose(30.0, 0.0, 0.0), np.array([(31.0, 0.0)]), NO_POINTS)
    assert [submap.index for submap in active.unfinished] == [2]


def test_starting_over_at_the_start_begins_the_first_submap():
    insertion = ActiveSubmaps(config(5)).insert(
        Pose(1.0, 2.0, 0.0), np.array([(2.0, 2.0)]), NO_POINTS, starts_over=True
    )
    assert indices(insertion) == [0]
    assert insertion.finished is None


def test_scanners_in_turn_do_not_count_as_travel():
    active = ActiveSubmaps(SubmapConfig(resolution=RESOLUTION, max_travel=25.0))
    robot, ends = Pose(0.0, 0.0, 0.0), np.array([(2.0, 0.0)])
    for scan in range(60):
        sensor = Pose(0.5 if scan % 2 else -0.5, 0.0, 0.0)
        insertion = active.insert(sensor, ends, NO_POINTS, tf_local_robot=robot)
    assert indices(insertion) == [0]
    assert active.submaps[0].travelled == 0.0


@pytest.mark.parametrize(("step", "weight"), [(0.2, 1), (0.45, 1), (0.75, 3), (1.0, 4), (3.0, 4)])
def test_a_sparse_scan_counts_for_the_path_since_the_last(step, weight):
    active, config_ = ActiveSubmaps(config(5)), config(5)
    active.insert(Pose(0.0, 0.0, 0.0), NO_POINTS, NO_POINTS)
    active.insert(Pose(step, 0.0, 0.0), np.array([(step + 1.0, 0.0)]), NO_POINTS)
    grid = active.submaps[0].grid
    odds = config_.hit_probability / (1.0 - config_.hit_probability)
    hit = odds**weight / (1.0 + odds**weight)
    assert grid.cells.max() == pytest.approx(min(hit, MAX_PROBABILITY), abs=1e-6)


@pytest.mark.parametrize(("step", "is_sparse"), [(0.0, False), (0.3, False), (0.6, True)])
def test_submaps_of_scans_far_apart_are_sparse(step, is_sparse):
    active = ActiveSubmaps(config(50))
    active.insert(Pose(0.0, 0.0, 0.0), NO_POINTS, NO_POINTS)
    assert not active.submaps[0].is_sparse
    for k in range(1, 5):
        active.insert(Pose(k * step, 0.0, 0.0), NO_POINTS, NO_POINTS)
    assert active.submaps[0].is_sparse == is_sparse


def wall_shown_by_noisy_ranges(noise):
    """The mean value of the cells of a wall 4 m away."""
    active, rng = ActiveSubmaps(SubmapConfig(resolution=0.05)), np.random.default_rng(0)
    angles = np.radians(np.arange(-20.0, 20.0, 2.0))
    beams = np.column_stack((np.cos(angles), np.sin(angles)))
    for k in range(60):
        sensor = Pose(0.0, 0.005 * k, 0.0)
        ranges = 4.0 / np.cos(angles) * (1.0 + 0.015 * rng.standard_normal(len(angles)))
        ends = np.array(sensor[:2]) + ranges[:, np.newaxis] * beams
        active.insert(sensor, ends, NO_POINTS, noise=noise)
    grid = active.submaps[0].grid
    rows = np.arange(-20, 20) - grid.first_row
    return grid.cells[rows, round(4.0 / 0.05) - grid.first_col].mean()


def test_rays_of_a_noisy_scanner_do_not_erase_the_wall():
    """Half of the rays end behind it, and pass through its cells."""
    unaware = wall_shown_by_noisy_ranges(NO_NOISE)
    assert wall_shown_by_noisy_ranges(Noise(share=0.015)) > unaware + 0.1
    assert wall_shown_by_noisy_ranges(Noise(constant=0.06)) > unaware + 0.1
