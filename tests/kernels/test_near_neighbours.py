# SPDX-License-Identifier: Apache-2.0
"""Returns with a neighbour near, against a slow and obvious reference."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.kernels.near_neighbours import (
    count_near_neighbours,
    hide_blocked,
    with_near_neighbour,
)

NEAR, SLOPE, SPACINGS = 0.3, 0.1, 0.8
MIN_RANGE, END_RANGE = 0.2, 8.0


def naive_with_near_neighbour(points):
    order = sorted(range(len(points)), key=lambda i: math.atan2(points[i][1], points[i][0]))
    angles = [math.atan2(points[i][1], points[i][0]) for i in order]
    spacing = float(np.median(np.diff(angles)))
    near = set()
    for k, i in enumerate(order):
        limit = NEAR + SPACINGS * spacing * math.hypot(*points[i])
        beside = [order[j] for j in (k - 1, k + 1) if 0 <= j < len(order)]
        if any(math.dist(points[i], points[j]) <= limit for j in beside):
            near.add(i)
    return points[sorted(near)]


def naive_counts(ranges):
    valid = [r if MIN_RANGE <= r < END_RANGE else math.nan for r in ranges]
    counts = [0] * len(ranges)
    for k in range(len(ranges) - 1):
        if abs(valid[k + 1] - valid[k]) <= NEAR + SLOPE * valid[k]:
            counts[k] = counts[k + 1] = 1
    return counts


@given(st.integers(0, 1000), st.integers(2, 60), st.floats(0.2, 5.0))
def test_points_are_compared_with_those_beside_them(seed, count, size):
    points = np.random.default_rng(seed).normal(0.0, size, (count, 2))
    near = with_near_neighbour(points, NEAR, SPACINGS)
    assert np.array_equal(near, naive_with_near_neighbour(points))


ranges = st.one_of(st.floats(0.0, 10.0), st.sampled_from([math.nan, math.inf, -1.0, 8.0, 0.2]))


@given(st.lists(ranges, max_size=30))
def test_ranges_are_compared_with_those_beside_them(values):
    counts = np.full(len(values), 7)
    count_near_neighbours(np.array(values, dtype=float), MIN_RANGE, END_RANGE, NEAR, SLOPE, counts)
    assert (counts - 7).tolist() == naive_counts(values)


@given(st.lists(st.tuples(ranges, st.integers(0, 9)), min_size=1, max_size=30), st.floats(0.0, 9.0))
def test_blocked_beams_hide_all_but_their_returns(beams, most):
    values, counts = (np.array(column) for column in zip(*beams, strict=True))
    hidden = np.empty(len(values))
    least = hide_blocked(values.astype(float), MIN_RANGE, END_RANGE, counts, most, hidden)
    expected = [
        value if count > most or MIN_RANGE <= value < END_RANGE else math.nan
        for value, count in beams
    ]
    np.testing.assert_array_equal(hidden, expected)
    assert least == min(counts)
