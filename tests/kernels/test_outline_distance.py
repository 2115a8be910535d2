# SPDX-License-Identifier: Apache-2.0
"""Points that are apart from an outline, against a slow and obvious reference."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.kernels.outline_distance import count_apart


def naive_distance(point, start, end):
    along = math.dist(start, end)
    direction = [(b - a) / along for a, b in zip(start, end, strict=True)]
    share = sum((p - a) * d for p, a, d in zip(point, start, direction, strict=True))
    share = min(max(share, 0.0), along)
    return math.dist(point, [a + share * d for a, d in zip(start, direction, strict=True)])


@given(st.integers(0, 1000), st.integers(0, 30), st.integers(1, 20), st.floats(0.01, 2.0))
def test_points_far_from_all_edges_are_counted(seed, num_points, num_edges, limit):
    rng = np.random.default_rng(seed)
    points = rng.normal(0.0, 2.0, (num_points, 2))
    starts, ends = rng.normal(0.0, 2.0, (2, num_edges, 2))

    count = count_apart(points, starts, ends, limit)

    edges = list(zip(starts.tolist(), ends.tolist(), strict=True))
    nearest = [min(naive_distance(point, *edge) for edge in edges) for point in points.tolist()]
    assert count == sum(distance > limit for distance in nearest)


@pytest.mark.parametrize(("x", "apart"), [(-1.0, 1), (-0.5, 0), (1.0, 0), (2.5, 0), (2.6, 1)])
def test_an_edge_ends_at_its_ends(x, apart):
    count = count_apart(np.array([(x, 0.0)]), np.zeros((1, 2)), np.array([(2.0, 0.0)]), 0.5)
    assert count == apart
