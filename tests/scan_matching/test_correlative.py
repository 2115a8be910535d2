# SPDX-License-Identifier: Apache-2.0
"""The correlative matcher over a probability grid: step sizes, windows, poses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import CorrelativeMatcherConfig, SubmapConfig
from cartoloop.kernels.window_bounds import box_sizes
from cartoloop.scan_matching.correlative import Scratch, match, step_of_points
from cartoloop.sensor.pose import Pose, inverse, transform_points, wrap_angle
from cartoloop.submaps.probability_grid import ProbabilityGrid, insert_cells, scan_cells

RESOLUTION = 0.05
MAX_RANGE = CorrelativeMatcherConfig().max_rotation_step_range
WINDOW = CorrelativeMatcherConfig(linear_search_window=0.2, angular_search_window_deg=10.0)


def l_shaped_walls():
    along = np.linspace(0.0, 4.0, 161)
    return np.concatenate(
        (
            np.column_stack((along - 2.0, np.full(161, 1.5))),
            np.column_stack((np.full(161, 2.0), along - 2.5)),
            np.column_stack((0.25 * along - 1.0, 0.5 * along - 1.5)),
        )
    )


@pytest.fixture(scope="module")
def grid():
    grid = ProbabilityGrid(RESOLUTION)
    cells = scan_cells(Pose(0.0, 0.0, 0.0), l_shaped_walls(), np.zeros((0, 2)), RESOLUTION)
    for _ in range(6):
        insert_cells(grid, cells, SubmapConfig(resolution=RESOLUTION, hit_probability=0.7))
    return grid


@settings(deadline=None, max_examples=60)
@given(farthest=st.floats(0.01, MAX_RANGE), resolution=st.sampled_from((0.05, 0.1, 0.25)))
def test_the_farthest_point_moves_by_no_more_than_a_pixel(farthest, resolution):
    points = np.array([(0.0, -farthest), (0.1 * farthest, 0.0)])
    step = step_of_points(points, resolution, MAX_RANGE)
    assert 0.0 < step <= math.radians(60.0) + 1e-12
    assert 2.0 * farthest * math.sin(0.5 * step) <= resolution * (1.0 + 1e-9)
    if farthest > resolution:
        assert step == pytest.approx(math.acos(1.0 - resolution**2 / (2.0 * farthest**2)))


def test_points_out_of_reach_make_the_rotation_step_no_finer():
    steps = [
        step_of_points(np.array([(far, 0.0)]), RESOLUTION, MAX_RANGE)
        for far in (MAX_RANGE, 30.0, 80.0)
    ]
    assert steps == [steps[0]] * 3


@pytest.mark.parametrize(
    "off",
    [
        Pose(0.0, 0.0, 0.0),
        Pose(0.17, -0.11, 0.0),
        Pose(-0.2, 0.2, 0.15),
        Pose(0.08, 0.13, -0.17),
    ],
)
def test_a_displaced_scan_is_found_within_a_pixel(grid, off):
    truth = Pose(0.12, -0.07, 0.4)
    points = transform_points(inverse(truth), l_shaped_walls())
    estimate = Pose(truth.x + off.x, truth.y + off.y, truth.theta + off.theta)

    found = match(grid, points, estimate, WINDOW)

    assert math.hypot(found.tf_submap_scan.x - truth.x, found.tf_submap_scan.y - truth.y) < 0.06
    assert abs(wrap_angle(found.tf_submap_scan.theta - truth.theta)) < 0.02
    assert found.score > 0.7


@settings(deadline=None, max_examples=30)
@given(
    x=st.floats(-9.0, 9.0),
    y=st.floats(-9.0, 9.0),
    theta=st.floats(-math.pi, math.pi),
)
def test_match_is_in_the_window_and_its_score_a_probability(grid, x, y, theta):
    found = match(grid, l_shaped_walls()[::16], Pose(x, y, theta), WINDOW)
    step = step_of_points(l_shaped_walls()[::16], RESOLUTION, MAX_RANGE)
    assert abs(found.tf_submap_scan.x - x) <= WINDOW.linear_search_window + RESOLUTION
    assert abs(found.tf_submap_scan.y - y) <= WINDOW.linear_search_window + RESOLUTION
    turned = abs(wrap_angle(found.tf_submap_scan.theta - theta))
    assert turned <= math.radians(WINDOW.angular_search_window_deg) + step
    assert -math.pi < found.tf_submap_scan.theta <= math.pi
    assert 0.1 - 1e-6 <= found.score <= 0.9 + 1e-6


def test_off_the_map_the_estimate_stays(grid):
    estimate = Pose(100.0, 100.0, 1.0)
    found = match(grid, l_shaped_walls(), estimate, WINDOW)
    assert found.tf_submap_scan == pytest.approx(estimate)
    assert found.score == pytest.approx(0.1, rel=1e-4)


def test_estimate_is_kept_if_far_candidates_are_hardly_better(grid):
    """The weights distinguish equally good candidates: along a wall the nearest one wins."""
    wall = np.column_stack((np.linspace(-1.0, 0.5, 31), np.full(31, 1.5)))
    found = match(grid, wall, Pose(0.0, 0.1, 0.0), WINDOW)
    assert found.tf_submap_scan.x == pytest.approx(0.0, abs=1e-9)
    assert found.tf_submap_scan.y == pytest.approx(0.0, abs=RESOLUTION)


def test_a_window_of_nothing_is_the_estimate_alone(grid):
    window = CorrelativeMatcherConfig(linear_search_window=0.0, angular_search_window_deg=0.0)
    estimate = Pose(0.123, -0.045, 0.01)
    assert match(grid, l_shaped_walls(), estimate, window).tf_submap_scan == pytest.approx(estimate)


def test_scratch_of_an_earlier_match_changes_nothing(grid):
    scratch = Scratch()
    narrow = CorrelativeMatcherConfig(linear_search_window=0.05, angular_search_window_deg=2.0)
    estimate = Pose(0.1, -0.05, 0.3)
    for window, points in (
        (WINDOW, l_shaped_walls()),
        (narrow, l_shaped_walls()[::7]),
        (WINDOW, l_shaped_walls()[::2]),
    ):
        alone = match(grid, points, estimate, window)
        assert match(grid, points, estimate, window, scratch) == alone


@settings(deadline=None, max_examples=60)
@given(half_width=st.integers(0, 200))
def test_the_scratch_has_room_for_all_sizes_of_boxes(half_width):
    assert len(box_sizes(2 * half_width + 1)) == 1 + (2 * half_width).bit_length()
