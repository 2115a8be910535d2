# SPDX-License-Identifier: Apache-2.0
"""Deskewing: beams and points of a tilting, moving scanner in the level frame."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.cloud_projection import CloudLimits, project_cloud
from cartoloop.kernels.range_projection import Position, RangeLimits, project_ranges
from cartoloop.kernels.sweep_projection import Heights, place_upright, project_sweep
from cartoloop.sensor.sweep_motion import AT_REST, SweepMotion, rotation, sensor_in_sweep
from tests.reference.naive_projection import naive_cloud, naive_place_upright, naive_sweep

coordinate = st.floats(-20.0, 20.0)
angle = st.floats(-0.5, 0.5)
knots = st.lists(
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), angle, angle, angle), min_size=1, max_size=5
).map(np.array)
motions = st.builds(SweepMotion, st.floats(-0.1, 0.0), st.floats(0.01, 0.1), knots)


@settings(deadline=None, max_examples=100)
@given(point=st.tuples(coordinate, coordinate, coordinate), time=st.floats(-0.5, 0.5), m=motions)
def test_deskewed_points_equal_the_reference(point, time, m):
    assert place_upright(*point, time, m) == pytest.approx(
        tuple(naive_place_upright(point, time, *m)), abs=1e-9
    )


LIMITS = RangeLimits(0.5, 10.0, 20.0, True, 4.0, 0)
HEIGHTS = Heights(-0.8, 2.0)


def sweep(
    ranges,
    directions,
    origin=(0.0, 0.0, 0.0),
    increment=0.0,
    motion=AT_REST,
    free=True,
    agreeing=0,
):
    returns, misses = np.empty((len(ranges), 2)), np.empty((len(ranges), 2))
    num_returns, num_misses = project_sweep(
        np.array(ranges, dtype=np.float64),
        np.array(directions, dtype=np.float64),
        Position(*origin),
        increment,
        motion,
        LIMITS._replace(no_return_is_free=free, num_agreeing=agreeing),
        HEIGHTS,
        returns,
        misses,
    )
    return returns[:num_returns], misses[:num_misses]


@settings(deadline=None, max_examples=100)
@given(
    beams=st.lists(
        st.tuples(
            st.one_of(
                st.floats(-1.0, 30.0), st.sampled_from((math.nan, math.inf, -math.inf, 20.0))
            ),
            st.floats(-math.pi, math.pi),
            st.floats(-0.5, 0.5),
        ),
        min_size=1,
        max_size=20,
    ),
    increment=st.floats(-0.01, 0.01),
    motion=motions,
    free=st.booleans(),
)
def test_deskewed_sweeps_equal_the_reference(beams, increment, motion, free):
    directions = np.array(
        [
            (math.cos(up) * math.cos(a), math.cos(up) * math.sin(a), math.sin(up))
            for _, a, up in beams
        ]
    )
    ranges = [measured for measured, _, _ in beams]
    origin = (0.2, -0.1, 0.3)

    returns, misses = sweep(ranges, directions, origin, increment, motion, free)

    expected = naive_sweep(ranges, directions, origin, increment, motion, LIMITS, HEIGHTS, free)
    assert returns == pytest.approx(np.array(expected[0]).reshape(-1, 2), abs=1e-9)
    assert misses == pytest.approx(np.array(expected[1]).reshape(-1, 2), abs=1e-9)


def test_a_sweep_at_rest_equals_the_plain_projection():
    rng = np.random.default_rng(4)
    ranges = np.concatenate((rng.uniform(-1.0, 25.0, 60), (math.nan, math.inf, -math.inf, 20.0)))
    angles = rng.uniform(-3.0, 3.0, len(ranges))
    level = np.column_stack((np.cos(angles), np.sin(angles)))
    plain = np.empty((len(ranges), 2)), np.empty((len(ranges), 2))
    counts = project_ranges(ranges, level, Position(0.3, -0.2, 0.0), LIMITS, *plain)

    returns, misses = sweep(ranges, np.column_stack((level, 0.0 * angles)), (0.3, -0.2, 0.0))

    assert returns == pytest.approx(plain[0][: counts[0]], abs=1e-12)
    assert misses == pytest.approx(plain[1][: counts[1]], abs=1e-12)


def test_lonely_beams_without_a_return_clear_nothing_in_a_sweep():
    ranges = [2.0, math.inf, 2.0, math.inf, math.inf, math.inf, 2.0]
    _, misses = sweep(ranges, [(1.0, 0.0, 0.0)] * len(ranges), agreeing=1)
    assert misses.tolist() == [[4.0, 0.0]]


def test_beams_that_hit_the_floor_are_ignored():
    down = SweepMotion(0.0, 1.0, np.array([(0.0, 0.0, 0.0, 0.0, 0.2)]))  # nose down
    returns, _ = sweep([3.0, 6.0], [(1.0, 0.0, 0.0)] * 2, motion=down)
    assert returns == pytest.approx(np.array([(3.0 * math.cos(0.2), 0.0)]))


def test_each_beam_is_rotated_by_the_turn_until_then():
    turning = SweepMotion(0.0, 0.1, np.array([(0.0,) * 5, (0.0, 0.0, 0.2, 0.0, 0.0)]))
    returns, _ = sweep([5.0] * 3, [(1.0, 0.0, 0.0)] * 3, increment=0.05, motion=turning)
    assert np.arctan2(returns[:, 1], returns[:, 0]) == pytest.approx([0.0, 0.1, 0.2])


def test_the_sensor_of_a_sweep_is_at_its_middle():
    from cartoloop.sensor.pose import Pose

    ahead = SweepMotion(0.0, 0.1, np.array([(0.0,) * 5, (0.4, 0.0, 0.0, 0.0, 0.0)]))
    assert sensor_in_sweep(Pose(0.1, 0.2, 0.3), 0.5, ahead)[:2] == pytest.approx((0.3, 0.2))


@settings(deadline=None, max_examples=60)
@given(
    points=st.lists(
        st.tuples(
            *(st.one_of(st.floats(-15.0, 15.0), st.sampled_from((math.nan, math.inf))),) * 2,
            st.floats(-3.0, 3.0),
        ),
        max_size=30,
    ),
    timed=st.booleans(),
    motion=motions,
    tilt=st.tuples(angle, angle, st.floats(-3.0, 3.0)),
)
def test_projected_clouds_equal_the_reference(points, timed, motion, tilt):
    points = np.array(points, dtype=np.float64).reshape(-1, 3)
    times = np.linspace(-0.1, 0.1, len(points)) if timed else np.empty(0)
    turn, shift = rotation(*tilt), Position(0.1, 0.2, 0.5)
    limits, centre = CloudLimits(0.3, 12.0, -0.8, 2.0), (0.05, -0.05)
    returns = np.empty((16, 2))

    kept = project_cloud(points, times, turn, shift, motion, limits, *centre, np.empty(16), returns)

    expected = naive_cloud(points, times, turn, shift, motion, limits, centre, 16)
    assert returns[:kept] == pytest.approx(np.array(expected).reshape(-1, 2), abs=1e-9)
