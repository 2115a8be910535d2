# SPDX-License-Identifier: Apache-2.0
"""Narrow objects that stand free."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.sensor.free_standing import (
    EDGE_RAD,
    JUMP_M,
    WIDEST_M,
    are_free_standing,
)

BEARINGS = np.radians(np.arange(-180.0, 180.0))


def points(ranges):
    """Returns at :data:`BEARINGS`."""
    return np.column_stack((ranges * np.cos(BEARINGS), ranges * np.sin(BEARINGS)))


def slowly_free_standing(returns, also_hidden):
    """The same, object by object, each grown from one return to both sides."""
    order = sorted(range(len(returns)), key=lambda i: math.atan2(returns[i][1], returns[i][0]))
    count, ranges = len(order), [math.hypot(*returns[i]) for i in order]
    free = [False] * count

    def angle(k):
        x, y = returns[order[k % count]]
        next_x, next_y = returns[order[(k + 1) % count]]
        return math.atan2(x * next_y - y * next_x, x * next_x + y * next_y) % math.tau

    angles = [angle(k) if count > 1 else math.tau for k in range(count)]
    edge = max(range(count), key=angles.__getitem__) if count else 0
    if count and angles[edge] <= EDGE_RAD:
        edge = -1

    def rise(k):
        if k % count == edge:
            return math.inf
        return ranges[(k + 1) % count] - ranges[k % count]

    def fall(k):
        return math.inf if (k - 1) % count == edge else -rise(k - 1)

    if all(abs(rise(k)) <= JUMP_M for k in range(count)):
        return free

    def ends(k):
        first = last = k
        while abs(fall(first)) <= JUMP_M:
            first -= 1
        while abs(rise(last)) <= JUMP_M:
            last += 1
        return first, last

    def is_narrow(first, last):
        return math.dist(returns[order[first % count]], returns[order[last % count]]) < WIDEST_M

    def is_whole(k):
        first, last = ends(k)
        return is_narrow(first, last) and 0.0 < min(fall(first), rise(last)) < math.inf

    for k in range(count):
        first, last = ends(k)
        is_hidden = (0.0 < fall(first) < math.inf and is_whole(last + 1)) or (
            0.0 < rise(last) < math.inf and is_whole(first - 1)
        )
        free[order[k]] = is_whole(k) or (also_hidden and is_narrow(first, last) and is_hidden)
    return free


@given(
    st.integers(0, 1000),
    st.integers(1, 40),
    st.floats(0.2, 3.0),
    st.floats(0.1, math.pi),
    st.booleans(),
)
def test_objects_grow_until_the_range_jumps(seed, count, size, view, also_hidden):
    rng = np.random.default_rng(seed)
    bearings = rng.uniform(-view, view, count)
    ranges = rng.uniform(1.0, 1.0 + size, count)
    returns = np.column_stack((ranges * np.cos(bearings), ranges * np.sin(bearings)))
    found = are_free_standing(returns, also_hidden=also_hidden)
    assert found.tolist() == slowly_free_standing(returns, also_hidden)


@pytest.mark.parametrize("bearing_deg", [0.0, 90.0, 180.0])
def test_a_person_stands_free_wherever_it_is(bearing_deg):
    off = np.abs(
        np.remainder(BEARINGS - math.radians(bearing_deg) + math.pi, 2 * math.pi) - math.pi
    )
    is_person = off < math.radians(8.0)
    found = are_free_standing(points(np.where(is_person, 1.5, 4.0)))
    assert found.tolist() == is_person.tolist()


def test_a_person_whom_another_one_hides_in_part_stands_free():
    is_near, is_far = np.arange(360) // 10 == 5, np.arange(360) // 10 == 6
    returns = points(np.where(is_near, 1.0, np.where(is_far, 2.0, 4.0)))
    assert are_free_standing(returns).tolist() == is_near.tolist()
    found = are_free_standing(returns, also_hidden=True)
    assert found.tolist() == (is_near | is_far).tolist()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_person_whom_the_edge_of_the_view_cuts_stands_free(side):
    seen = BEARINGS[np.abs(BEARINGS) <= math.pi / 2]
    is_person = side * seen > math.radians(75.0)
    ranges = np.where(is_person, 0.6, 1.0 / np.maximum(np.abs(np.sin(seen)), 0.2))
    found = are_free_standing(np.column_stack((ranges * np.cos(seen), ranges * np.sin(seen))))
    assert found.tolist() == is_person.tolist()


def test_all_that_is_seen_is_no_object():
    seen = np.radians(np.arange(-3.0, 4.0))
    assert not are_free_standing(np.column_stack((2.0 * np.cos(seen), 2.0 * np.sin(seen)))).any()


def test_what_is_joined_to_a_wall_does_not_stand_free():
    ranges = np.full(360, 4.0)
    ranges[100:115] = np.linspace(3.9, 3.0, 15)  # an open door, seen along its leaf
    assert not are_free_standing(points(ranges)).any()


def test_a_wide_object_is_no_person():
    ranges = np.full(360, 4.0)
    ranges[100:140] = 2.0  # 1.4 m
    assert not are_free_standing(points(ranges)).any()


def test_no_returns_have_no_objects():
    assert are_free_standing(np.empty((0, 2))).tolist() == []
