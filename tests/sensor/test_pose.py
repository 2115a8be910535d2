# SPDX-License-Identifier: Apache-2.0
"""Rigid transforms of the plane form a group, for one pose and for arrays of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.sensor.pose import (
    IDENTITY,
    Pose,
    compose,
    compose_all,
    interpolate,
    inverse,
    relative,
    relative_all,
    transform_points,
    wrap_angle,
    wrap_angles,
)

coordinate = st.floats(-1e3, 1e3)
angle = st.one_of(st.floats(-10.0, 10.0), st.sampled_from((math.pi, -math.pi, 3 * math.pi, 0.0)))
poses = st.builds(Pose, coordinate, coordinate, angle)
pose_lists = st.lists(poses, min_size=1, max_size=6)
properties = settings(deadline=None, max_examples=60)

BESIDE_PI = [
    sign * beside * turns
    for sign in (-1.0, 1.0)
    for beside in (math.nextafter(math.pi, 0.0), math.pi, math.nextafter(math.pi, 4.0))
    for turns in (1.0, 3.0, 5.0)
]


def assert_same(pose, expected):
    """The same place and heading, up to rounding."""
    assert pose[:2] == pytest.approx(expected[:2], abs=1e-9)
    assert wrap_angle(pose[2] - expected[2]) == pytest.approx(0.0, abs=1e-12)


def within_one_turn(pose):
    return -math.pi < pose[2] <= math.pi


@properties
@given(a=poses, b=poses, c=poses)
def test_composition_is_associative(a, b, c):
    assert_same(compose(compose(a, b), c), compose(a, compose(b, c)))


@properties
@given(a=poses)
def test_the_identity_changes_nothing(a):
    assert_same(compose(IDENTITY, a), a)
    assert_same(compose(a, IDENTITY), a)


@properties
@given(a=poses)
def test_a_pose_and_its_inverse_cancel(a):
    assert_same(compose(a, inverse(a)), IDENTITY)
    assert_same(compose(inverse(a), a), IDENTITY)


@properties
@given(a=poses, b=poses)
def test_composing_with_the_relative_pose_gives_the_other(a, b):
    assert_same(relative(a, b), compose(inverse(a), b))
    assert_same(compose(a, relative(a, b)), b)


@properties
@given(a=poses, b=poses)
def test_angles_of_results_are_within_one_turn(a, b):
    for pose in (compose(a, b), relative(a, b), inverse(a), interpolate(a, b, 0.3)):
        assert within_one_turn(pose)


@properties
@given(a=poses, b=poses, point=st.tuples(coordinate, coordinate))
def test_transforming_points_twice_equals_the_composition(a, b, point):
    points = np.array([point])
    twice = transform_points(a, transform_points(b, points))
    assert transform_points(compose(a, b), points) == pytest.approx(twice, abs=1e-8)


@properties
@given(a=poses, points=st.lists(st.tuples(coordinate, coordinate), max_size=5))
def test_a_point_is_transformed_like_the_position_of_a_pose(a, points):
    transformed = transform_points(a, np.array(points).reshape(-1, 2))
    assert transformed.shape == (len(points), 2)
    for point, place in zip(points, transformed, strict=True):
        assert compose(a, Pose(*point, 0.0))[:2] == pytest.approx(place)


@properties
@given(a=poses, b=poses)
def test_interpolation_starts_and_ends_at_the_given_poses(a, b):
    assert_same(interpolate(a, b, 0.0), a)
    assert_same(interpolate(a, b, 1.0), b)


@properties
@given(a=poses, b=poses, fraction=st.floats(0.0, 1.0))
def test_interpolation_is_straight_and_turns_less_than_pi(a, b, fraction):
    between = interpolate(a, b, fraction)
    expected = (a.x + fraction * (b.x - a.x), a.y + fraction * (b.y - a.y))
    assert between[:2] == pytest.approx(expected)
    turned = abs(wrap_angle(between.theta - a.theta))
    assert turned == pytest.approx(fraction * abs(wrap_angle(b.theta - a.theta)), abs=1e-9)


def test_interpolation_across_pi_turns_the_shorter_angle():
    between = interpolate(Pose(0.0, 0.0, 3.1), Pose(0.0, 0.0, -3.1), 0.5)
    assert abs(between.theta) == pytest.approx(math.pi)


@properties
@given(theta=st.floats(-1e4, 1e4))
def test_wrapping_changes_angles_by_whole_turns(theta):
    wrapped = wrap_angle(theta)
    assert -math.pi < wrapped <= math.pi
    turns = (theta - wrapped) / math.tau
    assert turns == pytest.approx(round(turns), abs=1e-9)


@pytest.mark.parametrize("theta", BESIDE_PI)
def test_angles_beside_pi_are_wrapped_into_the_interval(theta):
    assert -math.pi < wrap_angle(theta) <= math.pi
    assert -math.pi < wrap_angles(np.array([theta]))[0] <= math.pi


@pytest.mark.parametrize("theta", [math.pi, -math.pi])
def test_the_half_turn_is_positive(theta):
    assert wrap_angle(theta) == math.pi
    assert wrap_angles(np.array([theta]))[0] == math.pi


@properties
@given(theta=st.floats(-math.pi, math.pi, exclude_min=True))
def test_angles_in_the_interval_keep_every_bit(theta):
    assert wrap_angle(theta) == theta
    assert wrap_angles(np.array([theta]))[0] == theta


@properties
@given(angles=st.lists(st.floats(-100.0, 100.0), min_size=2, max_size=6))
def test_wrapping_an_array_equals_wrapping_each_angle(angles):
    wrapped = wrap_angles(np.array(angles).reshape(1, -1))
    assert wrapped.shape == (1, len(angles))
    for one, theta in zip(wrapped[0], angles, strict=True):
        assert wrap_angle(one - wrap_angle(theta)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("of_all", "of_one"), [(compose_all, compose), (relative_all, relative)])
@settings(deadline=None, max_examples=40)
@given(a=pose_lists, data=st.data())
def test_arrays_of_poses_equal_single_poses(of_all, of_one, a, data):
    b = data.draw(st.lists(poses, min_size=len(a), max_size=len(a)))
    results = of_all(np.array(a), np.array(b))
    assert results.shape == (len(a), 3)
    for result, one, other in zip(results, a, b, strict=True):
        assert_same(result, of_one(one, other))
        assert within_one_turn(result)


@pytest.mark.parametrize(("of_all", "of_one"), [(compose_all, compose), (relative_all, relative)])
@settings(deadline=None, max_examples=40)
@given(many=pose_lists, single=poses)
def test_one_pose_is_broadcast_to_all_rows(of_all, of_one, many, single):
    for result, one in zip(of_all(np.array(many), np.array(single)), many, strict=True):
        assert_same(result, of_one(one, single))
    for result, one in zip(of_all(np.array(single), np.array(many)), many, strict=True):
        assert_same(result, of_one(single, one))


def test_arrays_without_poses_stay_empty():
    none = np.zeros((0, 3))
    assert compose_all(none, none).shape == relative_all(none, none).shape == (0, 3)
