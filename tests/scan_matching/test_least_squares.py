# SPDX-License-Identifier: Apache-2.0
"""Least-squares matching to a map built of scans: poses, angles, residual and information."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.config import SubmapConfig
from cartoloop.scan_matching.least_squares import MatchOptions, SmoothMap, match
from cartoloop.sensor.pose import Pose, inverse, transform_points, wrap_angle
from cartoloop.submaps.finished_grid import MIN_PROBABILITY
from cartoloop.submaps.probability_grid import ProbabilityGrid, insert_cells, scan_cells
from tests.reference.naive_scan_residuals import naive_smooth_probability

RESOLUTION = 0.05
WEAK = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
STRONG = 1e10 * WEAK
TOLERANCE = 1e-5
MAX_ITERATIONS = 60


def walls(rng, num_points=240):
    """Noisy points on the walls of a room of 6 x 4 m."""
    at = np.linspace(0.0, 1.0, num_points // 4, endpoint=False)
    x, y = 6.0 * at - 3.0, 4.0 * at - 2.0
    sides = [(x, -2.0 + 0 * x), (x, 2.0 + 0 * x), (-3.0 + 0 * y, y), (3.0 + 0 * y, y)]
    points = np.concatenate([np.column_stack(side) for side in sides])
    return points + rng.normal(scale=0.01, size=points.shape)


@pytest.fixture(scope="module")
def room():
    grid, rng = ProbabilityGrid(RESOLUTION), np.random.default_rng(6)
    for _ in range(30):
        cells = scan_cells(Pose(0.1, 0.2, 0.0), walls(rng), np.zeros((0, 2)), RESOLUTION)
        insert_cells(grid, cells, SubmapConfig(resolution=RESOLUTION))
    return SmoothMap(grid.cells, grid.origin_x, grid.origin_y, grid.resolution)


def scan_at(truth, seed=1):
    return transform_points(inverse(truth), walls(np.random.default_rng(seed)))


@pytest.mark.parametrize("truth", [Pose(0, 0, 0), Pose(0.4, -0.3, 1.2), Pose(-1.0, 0.5, -3.1)])
@pytest.mark.parametrize("off", [(0.06, 0.05, 0.02), (-0.07, 0.04, -0.03)])
def test_a_scan_is_found_to_a_fraction_of_a_pixel(room, truth, off):
    start = Pose(*(a + b for a, b in zip(truth, off, strict=True)))
    found = match(
        room, scan_at(truth), start, start, WEAK, MatchOptions(10.0, MAX_ITERATIONS, TOLERANCE)
    )
    assert found.tf_submap_scan[:2] == pytest.approx(truth[:2], abs=0.01)
    assert wrap_angle(found.tf_submap_scan.theta - truth.theta) == pytest.approx(0.0, abs=5e-3)


@pytest.mark.parametrize(("start", "prior"), [(3.13, -3.13), (-3.13, 3.13)])
def test_headings_either_side_of_the_half_turn_are_neighbours(room, start, prior):
    truth = Pose(0.1, 0.0, math.pi)
    found = match(
        room,
        scan_at(truth),
        Pose(0.1, 0.0, start),
        Pose(0.1, 0.0, prior),
        WEAK,
        MatchOptions(10.0, MAX_ITERATIONS, TOLERANCE),
    )
    assert wrap_angle(found.tf_submap_scan.theta - math.pi) == pytest.approx(0.0, abs=5e-3)
    assert -math.pi < found.tf_submap_scan.theta <= math.pi


@pytest.mark.parametrize(("start", "prior"), [(3.13, -3.13), (-3.13, 3.13)])
def test_prior_across_the_half_turn_uses_the_smaller_angle(room, start, prior):
    points, information = scan_at(Pose(0, 0, math.pi)), 1e4 * WEAK
    apart, together = (
        match(
            room,
            points,
            Pose(0, 0, start),
            Pose(0, 0, held_to),
            information,
            MatchOptions(1.0, 1, TOLERANCE),
        )
        for held_to in (prior, start)
    )
    turn = wrap_angle(start - prior)
    assert apart.cost - together.cost == pytest.approx(1e4 * turn**2, rel=1e-3)


def test_residual_is_root_mean_square_of_one_minus_map(room):
    truth = Pose(0.2, 0.1, 0.3)
    points = scan_at(truth)
    found = match(room, points, truth, truth, WEAK, MatchOptions(10.0, MAX_ITERATIONS, TOLERANCE))
    ends = transform_points(found.tf_submap_scan, points)
    lacks = [
        1.0
        - naive_smooth_probability(
            room.cells,
            MIN_PROBABILITY,
            (x - room.origin_x) / RESOLUTION,
            (y - room.origin_y) / RESOLUTION,
        )
        for x, y in ends.tolist()
    ]
    assert found.residual == pytest.approx(math.sqrt(np.mean(np.square(lacks))))


def test_a_scan_in_its_place_fits_better_than_one_that_is_not(room):
    truth = Pose(0.2, 0.1, 0.3)
    right = match(
        room, scan_at(truth), truth, truth, WEAK, MatchOptions(10.0, MAX_ITERATIONS, TOLERANCE)
    )
    wrong = Pose(0.5, -0.3, 0.5)
    held = match(
        room, scan_at(truth), wrong, wrong, STRONG, MatchOptions(1.0, MAX_ITERATIONS, TOLERANCE)
    )
    assert right.residual < 0.5 * held.residual


def test_information_is_symmetric_and_grows_with_points(room):
    truth = Pose(0.2, 0.1, 0.3)
    points = scan_at(truth)
    once = match(room, points, truth, truth, WEAK, MatchOptions(10.0, MAX_ITERATIONS, TOLERANCE))
    twice = match(
        room,
        np.vstack((points, points)),
        truth,
        truth,
        WEAK,
        MatchOptions(5.0, MAX_ITERATIONS, TOLERANCE),
    )
    assert np.array_equal(once.information, once.information.T)
    assert np.linalg.eigvalsh(once.information).min() > 0.0
    assert twice.information == pytest.approx(2.0 * once.information, rel=0.05, abs=1.0)


def test_no_more_iterations_than_allowed_are_made(room):
    truth = Pose(0.2, 0.1, 0.3)
    start = Pose(0.27, 0.04, 0.33)
    for limit in (1, 2, 5):
        found = match(
            room, scan_at(truth), start, start, WEAK, MatchOptions(10.0, limit, TOLERANCE)
        )
        assert 1 <= found.iterations <= limit
    assert (
        match(
            room, scan_at(truth), start, start, WEAK, MatchOptions(10.0, 1, TOLERANCE)
        ).tf_submap_scan
        == start
    )


def test_the_same_match_twice_gives_the_same_bits(room):
    truth, start = Pose(0.2, 0.1, 0.3), Pose(0.25, 0.05, 0.32)
    first, second = (
        match(
            room, scan_at(truth), start, start, WEAK, MatchOptions(10.0, MAX_ITERATIONS, TOLERANCE)
        )
        for _ in range(2)
    )
    assert first.tf_submap_scan == second.tf_submap_scan
    assert np.array_equal(first.information, second.information)
