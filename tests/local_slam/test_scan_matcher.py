# SPDX-License-Identifier: Apache-2.0
"""Matched poses from good and bad predictions."""

from __future__ import annotations

import itertools
import math
from functools import partial

import numpy as np
import pytest

from cartoloop.config import LocalSlamConfig
from cartoloop.local_slam.gap import Gap
from cartoloop.local_slam.prediction import Prediction, isotropic_information
from cartoloop.local_slam.scan_matcher import MAX_IGNORED_LOST, ScanMatcher, follows_odometry
from cartoloop.local_slam.seen_points import values_at
from cartoloop.scan_matching import correlative
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import (
    Pose,
    compose,
    inverse,
    transform_points,
    wrap_angle,
)
from cartoloop.submaps.submap import ActiveSubmaps

CONFIG = LocalSlamConfig()
TRUTH = Pose(0.4, -0.3, 0.5)


def walls(seed):
    """Noisy points on the walls of a room that looks different from everywhere."""
    rng = np.random.default_rng(seed)
    corners = [(-3.0, -2.0), (3.5, -2.0), (3.5, 1.0), (1.5, 1.0), (1.5, 2.5), (-3.0, 2.5)]
    sides = zip(corners, corners[1:] + corners[:1], strict=True)
    points = [np.linspace(a, b, int(math.dist(a, b) / 0.06), endpoint=False) for a, b in sides]
    return np.concatenate(points) + rng.normal(scale=0.01, size=(sum(map(len, points)), 2))


@pytest.fixture(scope="module")
def submap():
    active = ActiveSubmaps(CONFIG.submaps)
    nowhere = np.zeros((0, 2))
    for seed in range(20):
        active.insert(Pose(0.37, -0.21, 0.0), walls(seed), nowhere)
    return active.submaps[0]


def points(truth=TRUTH):
    return transform_points(inverse(truth), walls(99))


def matched(submap, prediction, last=TRUTH, by_odometry=True, matcher=None, seen=None):
    """The match of a scan, by default at TRUTH; `last` is the pose of the scan before."""
    config = CONFIG.prediction
    information = isotropic_information(
        config.unknown_translation_sigma if by_odometry else config.lost_translation_sigma,
        config.unknown_rotation_sigma if by_odometry else config.lost_rotation_sigma,
    )
    prior = Prediction(prediction, by_odometry, information, lambda: (last, last))
    matcher = matcher or ScanMatcher(CONFIG)
    return matcher.match(submap, points() if seen is None else seen, prior)


def assert_near(found, truth, distance=0.03, angle=0.02):
    assert math.hypot(found.x - truth.x, found.y - truth.y) < distance
    assert abs(wrap_angle(found.theta - truth.theta)) < angle


def off(x, y, theta):
    return Pose(TRUTH.x + x, TRUTH.y + y, TRUTH.theta + theta)


@pytest.mark.parametrize("by_odometry", [True, False])
@pytest.mark.parametrize("error", [(0, 0, 0), (0.04, -0.03, 0.02), (-0.06, 0.05, -0.03)])
def test_a_good_prediction_is_refined(submap, error, by_odometry):
    found = matched(submap, off(*error), by_odometry=by_odometry)
    assert_near(found.tf_local_tracking, TRUTH)


def test_the_match_is_in_the_submap_frame(submap):
    assert submap.tf_local_submap != Pose(0.0, 0.0, 0.0)
    found = matched(submap, TRUTH)
    in_local = compose(submap.tf_local_submap, found.match.tf_submap_scan)
    assert found.tf_local_tracking == pytest.approx(in_local)


@pytest.mark.parametrize("jump", [(5.0, 3.0, 0.0), (-20.0, 0.0, 1.5), (0.0, 0.0, 1.0)])
def test_after_a_jump_of_odometry_fallback_poses_are_searched(submap, jump):
    matcher = ScanMatcher(CONFIG)
    for _ in range(30):  # until the typical residual has settled
        matched(submap, TRUTH, matcher=matcher)
    before = matcher.num_lost
    last = Pose(TRUTH.x - 0.1, TRUTH.y + 0.1, TRUTH.theta - 0.1)
    found = matched(submap, off(*jump), last, matcher=matcher)
    assert_near(found.tf_local_tracking, TRUTH)
    assert matcher.num_lost == before + 1


@pytest.mark.parametrize("is_far", [True, False])
def test_after_a_far_step_pixels_are_searched_at_once(submap, is_far):
    matcher = ScanMatcher(CONFIG)
    # scans that fit badly have made each residual a usual one
    matcher.memory = matcher.memory._replace(typical_residual=2.0)
    information = isotropic_information(0.1, 0.1)
    prediction = off(0.1, -0.1, 0.3)
    prior = Prediction(prediction, True, information, lambda: (TRUTH, TRUTH), is_far=is_far)

    found = matcher.match(submap, points(), prior).tf_local_tracking

    assert matcher.num_correlative == is_far
    assert (abs(wrap_angle(found.theta - TRUTH.theta)) < 0.02) == is_far


def match_of_odometry_at_rest(submap, last, moving):
    """The match of a scan at TRUTH that fits as usual anywhere near; the odometry reports rest."""
    matcher = ScanMatcher(CONFIG)
    matcher.memory = matcher.memory._replace(typical_residual=4.0)
    information = isotropic_information(0.01, 0.01)
    prior = Prediction(last, True, information, lambda: (last, moving), stands=True)
    found = matcher.match(submap, points(), prior)
    assert matcher.num_lost == 0
    return found.tf_local_tracking


def test_a_robot_that_has_not_stopped_with_its_odometry_goes_on(submap):
    last = off(-0.2, 0.0, 0.0)
    assert_near(match_of_odometry_at_rest(submap, last, TRUTH), TRUTH)
    slower_than_that = match_of_odometry_at_rest(submap, last, off(-0.19, 0.0, 0.0))
    assert_near(slower_than_that, last, distance=0.1)


def test_a_robot_that_stops_with_its_odometry_stands(submap):
    assert_near(match_of_odometry_at_rest(submap, TRUTH, off(0.2, 0.0, 0.0)), TRUTH)


@pytest.mark.parametrize("step", [Pose(0.7, 0.05, 0.1), Pose(1.1, -0.2, -0.3)])
def test_a_step_backwards_reported_as_forwards_is_found(submap, step):
    matcher = ScanMatcher(CONFIG)
    for _ in range(30):
        matched(submap, TRUTH, matcher=matcher)
    last = compose(TRUTH, step)
    reported = compose(last, Pose(step.x, -step.y, -step.theta))
    certain = isotropic_information(0.03, 0.05)
    prior = Prediction(reported, True, certain, lambda: (last, compose(last, step)))
    found = matcher.match(submap, points(), prior)
    assert_near(found.tf_local_tracking, TRUTH)


def test_a_single_box_does_not_turn_the_robot():
    active = ActiveSubmaps(CONFIG.submaps)
    box = np.array([(3.0, y) for y in np.linspace(-0.2, 0.2, 20)])
    for _ in range(20):
        active.insert(Pose(0.0, 0.0, 0.0), box, np.zeros((0, 2)))
    # Seen 5 cm to the left of where the odometry leads: a turn explains it as well as a step.
    seen = box + np.array((0.0, 0.05))

    found = matched(active.submaps[0], Pose(0.0, 0.0, 0.0), Pose(0.0, 0.0, 0.0), seen=seen)

    _, y, theta = found.tf_local_tracking
    assert abs(theta) < math.radians(0.3)
    assert y < 3.0 * theta < 0.0


@pytest.mark.parametrize(("seen", "follows"), [("room", False), ("box", True)])
def test_what_little_is_seen_follows_odometry_if_it_is_flat(seen, follows):
    """Points on the ridge of a wall have no curvature, however much they show."""
    match = LeastSquaresMatch(TRUTH, np.zeros((3, 3)), 0.0, 0.0, 1)
    prediction = Prediction(TRUTH, True, np.zeros(6), lambda: (TRUTH, TRUTH))
    points = walls(0) if seen == "room" else np.array([(3.0, y) for y in np.linspace(0.0, 0.4, 20)])

    assert follows_odometry(match, prediction, points) is follows
    assert not follows_odometry(match, prediction._replace(by_odometry=False), points)


def test_a_scan_is_not_searched_all_around_after_a_long_step(submap, monkeypatch):
    matcher, windows = ScanMatcher(CONFIG), []
    for _ in range(30):
        matched(submap, TRUTH, matcher=matcher)
    search = correlative.match
    monkeypatch.setattr(
        correlative,
        "match",
        lambda *args: windows.append(args[3].linear_search_window) or search(*args),
    )
    last, certain = off(0.0, 0.0, 2.0), isotropic_information(0.03, 0.05)
    for length in (2.0, 60.0):
        prior = Prediction(off(length, 0.0, 0.0), True, certain, lambda: (last, last))
        matcher.match(submap, points(), prior)
    assert max(windows) == pytest.approx(2.4)


@pytest.mark.parametrize("max_lost_scans", [1, 5])
def test_scans_in_turn_weigh_together_against_odometry(submap, max_lost_scans):
    window = CONFIG.correlative_matcher.model_copy(update={"max_lost_scans": max_lost_scans})
    matcher = ScanMatcher(CONFIG.model_copy(update={"correlative_matcher": window}))
    for _ in range(30):
        matched(submap, TRUTH, matcher=matcher)
    # The robot was turned, its wheels were not: they are right about all steps but that one.
    certain = isotropic_information(0.005, 0.002)
    sparse, pose, followed = points()[::14], off(0.0, 0.0, 0.5), []
    for _ in range(6):
        prior = Prediction(pose, True, certain, lambda: (TRUTH, TRUTH))
        found = matcher.match(submap, sparse, prior)
        followed.append(abs(found.tf_local_tracking.theta - TRUTH.theta) < 0.05)
        assert (matcher.lost_in_turn == 0) == followed[-1]
    assert not followed[0]
    assert any(followed) == (max_lost_scans > 1)


def test_lost_scans_change_what_is_usual_only_if_they_go_on(submap):
    matcher = ScanMatcher(CONFIG)
    for _ in range(30):
        matched(submap, TRUTH, matcher=matcher)
    usual = matcher.memory[0]
    certain, residuals = isotropic_information(1e-4, 1e-4), []
    prior = Prediction(TRUTH, True, certain, lambda: (TRUTH, TRUTH))
    for _ in range(MAX_IGNORED_LOST + 10):
        matcher.match(submap, 0.8 * points(), prior)  # a smaller room
        residuals.append(matcher.memory[0])
    assert residuals[MAX_IGNORED_LOST - 1] == usual
    assert residuals[-1] > residuals[MAX_IGNORED_LOST] > usual


@pytest.mark.parametrize("turn", [2.0, -2.5, math.pi])
def test_lost_scans_find_the_heading_they_agree_on(submap, turn):
    matcher = ScanMatcher(CONFIG)
    for _ in range(30):
        matched(submap, TRUTH, matcher=matcher)
    # A wrong turn of the odometry, which is right about all steps but that one.
    certain = isotropic_information(0.005, 0.002)
    pose, relocated = off(0.0, 0.0, turn), []
    for _ in range(5):
        fallbacks = partial(itertools.repeat, pose, 2)
        found = matcher.match(submap, points(), Prediction(pose, True, certain, fallbacks))
        pose = found.tf_local_tracking
        relocated.append(found.is_relocated)
    assert relocated == [False, False, True, False, False]
    assert_near(pose, TRUTH)


@pytest.mark.parametrize(("turn", "is_found"), [(0.5, True), (0.0, False)])
def test_poor_fits_of_different_views_agree_on_a_heading(submap, turn, is_found):
    """Much has changed, so that scans fit nowhere well: two of the same view would say nothing."""
    rng, matcher = np.random.default_rng(7), ScanMatcher(CONFIG)
    for _ in range(30):
        matched(submap, TRUTH, matcher=matcher)
    certain, relocated = isotropic_information(0.005, 0.002), []
    truth, last = TRUTH, off(0.0, 0.0, 1.3)
    for _ in range(5):
        scan = transform_points(inverse(truth), walls(99))
        changed = rng.random(len(scan)) < 0.45
        scan[changed] = rng.uniform(-3.0, 3.0, (np.count_nonzero(changed), 2))
        predicted = last._replace(theta=last.theta + turn)
        fallbacks = partial(itertools.repeat, last, 2)
        found = matcher.match(submap, scan, Prediction(predicted, True, certain, fallbacks))
        relocated.append(found.is_relocated)
        if found.is_relocated:
            assert_near(found.tf_local_tracking, truth, 0.1, 0.05)
            break
        last, truth = predicted, truth._replace(theta=truth.theta + turn)
    assert any(relocated) == is_found


def test_a_robot_that_drives_is_not_turned(submap):
    matcher = ScanMatcher(CONFIG)
    for _ in range(30):
        matched(submap, TRUTH, matcher=matcher)
    certain, pose = isotropic_information(0.005, 0.002), off(0.0, 0.0, 2.0)
    before = compose(pose, Pose(-0.2, 0.0, 0.0))
    for _ in range(5):
        fallbacks = partial(itertools.repeat, before, 2)
        found = matcher.match(submap, points(), Prediction(pose, True, certain, fallbacks))
        assert not found.is_relocated


def test_a_corridor_looks_alike_in_both_directions():
    """Lost scans between bare walls fit as well when turned by half a turn, and are not."""
    rng = np.random.default_rng(5)

    def corridor(noise):
        along = np.arange(-8.0, 8.0, 0.05)
        sides = np.concatenate([np.column_stack((along, np.full(320, y))) for y in (-1.0, 2.2)])
        return sides + rng.normal(0.0, noise, sides.shape)

    active, matcher = ActiveSubmaps(CONFIG.submaps), ScanMatcher(CONFIG)
    for _ in range(20):
        active.insert(Pose(0.0, 0.0, 0.0), corridor(0.005), np.zeros((0, 2)))
    here = Pose(0.0, 0.0, 0.0)
    prior = Prediction(here, True, isotropic_information(0.005, 0.002), lambda: (here, here))
    for _ in range(60):
        matcher.match(active.submaps[0], corridor(0.005), prior)
    # A scan of the corridor from the other side, as if the heading were wrong by half a turn.
    for _ in range(5):
        found = matcher.match(active.submaps[0], -corridor(0.005), prior)
        assert not found.is_relocated
    assert matcher.lost_in_turn == 5


def test_a_turn_must_fit_better_where_the_map_is_known():
    """Where the odometry leads, a third of the returns is on known walls, the rest on unknown ones.

    Turned, the rest is on known walls, and the third on floor.
    """
    active, nowhere = ActiveSubmaps(CONFIG.submaps), np.zeros((0, 2))
    for seed in range(20):
        room = walls(seed)
        active.insert(Pose(0.37, -0.21, 0.0), room[room[:, 0] < -0.5], nowhere)
    known = walls(99)[walls(99)[:, 0] < -0.5]
    turned = off(0.0, 0.0, 0.3)
    rest = transform_points(inverse(turned), known)
    beyond = transform_points(TRUTH, rest)
    outside = values_at(active.submaps[0].grid, beyond, Pose(0.0, 0.0, 0.0)) == 0.0
    scan = np.concatenate((transform_points(inverse(TRUTH), known[::4]), rest[outside]))
    information = isotropic_information(0.05, 0.1)
    prior = Prediction(TRUTH, True, information, lambda: (TRUTH, TRUTH))
    found = ScanMatcher(CONFIG).match(active.submaps[0], scan, prior)
    assert_near(found.tf_local_tracking, TRUTH, 0.1, 0.05)


@pytest.mark.parametrize("by", [(0.0, 0.0, 2.2), (1.5, -1.0, -1.0)])
def test_odometry_that_jumped_is_believed_where_the_scan_agrees(submap, by):
    information = isotropic_information(0.2, 0.2)
    for reported, expected in ((off(0.1, -0.05, 0.1), TRUTH), (off(9.0, 4.0, 1.0), None)):
        matcher = ScanMatcher(CONFIG)
        for _ in range(30):
            matched(submap, TRUTH, matcher=matcher)
        assumed = off(*by)
        prior = Prediction(
            assumed, False, information, lambda at=assumed: (at, at), over_jump=reported
        )
        found = matcher.match(submap, points(), prior).tf_local_tracking
        # A jump that is none leads to where nothing was seen.
        assert_near(found, expected or assumed, *((0.03, 0.02) if expected else (1.0, 1.1)))


@pytest.mark.parametrize("seen", [1.0, 0.4])
@pytest.mark.parametrize("by", [(0.5, -0.4, 0.2), (-0.6, 0.2, -0.3)])
def test_after_a_gap_odometry_may_be_wrong_by_far(submap, by, seen):
    """Also where a scan shows much that is new, and does not fit as usual anywhere."""
    start = off(-6.0 * by[0], 0.5, 0.1)
    scan = points()
    new = np.random.default_rng(1).uniform(4.5, 9.0, (round((1.0 / seen - 1.0) * len(scan)), 2))
    scan = np.concatenate((scan, transform_points(inverse(TRUTH), new)))
    certain = isotropic_information(0.01, 0.02)
    for gap in (Gap((off(*by),), 0.7, 0.1, 0.1, 0.7, 0.1), None):
        matcher = ScanMatcher(CONFIG)
        for _ in range(30):
            matched(submap, TRUTH, matcher=matcher)
        prior = Prediction(off(*by), True, certain, lambda: (start, start), gap=gap)
        found = matcher.match(submap, scan, prior)
        pose = found.tf_local_tracking
        error = math.hypot(pose.x - TRUTH.x, pose.y - TRUTH.y)
        assert (error < 0.05) == (gap is not None)
        if gap is not None:
            assert matcher.is_misfit(found.match) == (seen < 1.0)


@pytest.mark.parametrize("turn_error", [0.1, 0.6])
def test_a_robot_that_turned_may_have_turned_on_in_a_gap(submap, turn_error):
    matcher = ScanMatcher(CONFIG)
    for _ in range(30):
        matched(submap, TRUTH, matcher=matcher)
    predicted, certain = off(0.05, 0.05, 1.4), isotropic_information(0.01, 0.02)
    gap = Gap((predicted,), 0.3, 0.1, turn_error, 0.3, 0.1)
    prior = Prediction(predicted, True, certain, lambda: (predicted, predicted), gap=gap)
    found = matcher.match(submap, points(), prior).tf_local_tracking
    assert (abs(wrap_angle(found.theta - TRUTH.theta)) < 0.02) == (turn_error > 0.5)


def test_what_buffered_odometry_may_mean_is_searched(submap):
    matcher = ScanMatcher(CONFIG)
    for _ in range(30):
        matched(submap, TRUTH, matcher=matcher)
    predicted, certain = off(0.0, 0.0, 1.4), isotropic_information(0.01, 0.02)
    prior = Prediction(
        predicted,
        True,
        certain,
        lambda: (predicted, predicted),
        gap=Gap((predicted, off(4.0, 1.0, 0.5), off(0.05, 0.02, -0.1)), 0.3, 0.1, 0.1, 0.3, 0.1),
    )
    assert_near(matcher.match(submap, points(), prior).tf_local_tracking, TRUTH)


def test_after_a_gap_scans_of_new_places_stay_with_odometry(submap):
    matcher = ScanMatcher(CONFIG)
    for _ in range(30):
        matched(submap, TRUTH, matcher=matcher)
    start = off(6.0, 4.0, 0.2)
    predicted, certain = off(9.0, 5.0, 0.3), isotropic_information(0.01, 0.02)
    prior = Prediction(
        predicted,
        True,
        certain,
        lambda: (start, start),
        gap=Gap((predicted, off(8.0, 5.0, 0.0)), 1.0, 0.1, 0.1, 1.0, 0.1),
    )
    assert_near(matcher.match(submap, points(), prior).tf_local_tracking, predicted)


def test_lost_scans_of_elsewhere_are_not_turned(submap):
    matcher = ScanMatcher(CONFIG)
    for _ in range(30):
        matched(submap, TRUTH, matcher=matcher)
    certain = isotropic_information(0.005, 0.002)
    scan = np.random.default_rng(3).uniform(-3.0, 3.0, (200, 2))  # a crowd around the robot
    for _ in range(5):
        prior = Prediction(TRUTH, True, certain, lambda: (TRUTH, TRUTH))
        found = matcher.match(submap, scan, prior)
        assert not found.is_relocated
        assert_near(found.tf_local_tracking, TRUTH)


def test_scans_that_fit_well_need_no_wider_search(submap):
    matcher = ScanMatcher(CONFIG)
    for _ in range(60):
        matched(submap, TRUTH, matcher=matcher)
    settled = matcher.num_correlative
    for _ in range(20):
        matched(submap, off(0.01, -0.01, 0.005), matcher=matcher)
    assert matcher.num_correlative == settled
    assert matcher.num_lost == 0


def test_the_same_scans_give_the_same_pose(submap):
    first, second = (matched(submap, off(0.05, 0.02, -0.02)) for _ in range(2))
    assert first.tf_local_tracking == second.tf_local_tracking


def test_after_a_pause_between_bare_walls_odometry_is_believed():
    """At rest a scan fits there as well; the heading is a little off."""
    active, nowhere = ActiveSubmaps(CONFIG.submaps), np.zeros((0, 2))
    rng = np.random.default_rng(5)

    def corridor(x):
        along = np.arange(x - 8.0, x + 8.0, 0.05)
        sides = np.concatenate([np.column_stack((along, np.full(320, y))) for y in (-1.0, 1.2)])
        return sides + rng.normal(0.0, 0.01, sides.shape)

    for k in range(20):
        active.insert(Pose(0.2 * k, 0.0, 0.0), corridor(0.2 * k), nowhere)
    matcher, information = ScanMatcher(CONFIG), isotropic_information(0.02, 0.005)

    def match(x, theta):
        pose, rest = Pose(x, 0.0, theta), Pose(3.8, 0.0, 0.0)
        prior = Prediction(pose, True, information, lambda: (rest, rest))
        return matcher.match(active.submaps[0], corridor(0.0), prior).tf_local_tracking

    for _ in range(150):
        match(3.8, 0.0)
    found = match(7.3, 0.04)
    assert matcher.num_lost == 1
    assert_near(found, Pose(7.3, 0.0, 0.0), 0.1, 0.03)


def test_odometry_into_unobserved_space_is_believed(submap):
    # another room: at the fallback it overlaps the map, and half of it fits better than nothing
    outside = compose(TRUTH, Pose(0.0, 9.0, 0.0))
    another = points().copy()
    another[another[:, 0] < 0.0] *= 1.3
    information = isotropic_information(0.02, 0.1)
    prior = Prediction(outside, True, information, lambda: (TRUTH, TRUTH))
    matcher = ScanMatcher(CONFIG)
    for _ in range(150):
        matcher.match(submap, points(), prior._replace(tf_local_tracking=TRUTH))
    found = matcher.match(submap, another, prior)
    assert matcher.num_lost == 1
    assert_near(found.tf_local_tracking, outside, 0.1, 0.1)


def test_values_at_points_are_those_of_their_cells(submap):
    grid = submap.grid
    row, column = np.argwhere(grid.cells > 0.5)[0]
    at = np.array((grid.origin_x, grid.origin_y)) + grid.resolution * np.array((column, row))
    far = np.array((1e3, -1e3))
    values = values_at(grid, np.array((at, far)), Pose(0.0, 0.0, 0.0))
    np.testing.assert_array_equal(values, (np.float64(grid.cells[row, column]), 0.0))
