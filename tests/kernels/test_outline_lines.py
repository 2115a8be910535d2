# SPDX-License-Identifier: Apache-2.0
"""The lines of an outline, against comparing bearings one after the other."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop._jit import kernel
from cartoloop.kernels.outline_lines import (
    Outline,
    line_towards,
    lines_of,
    places_in_sectors,
    trace_outline,
)
from cartoloop.sensor.pose import Pose, inverse, transform_points
from tests.kernels.test_outline_shift import MAX_GAP, scan_of

seeds = st.integers(0, 2**32 - 1)


@kernel
def lines_towards(lines, sectors, points):
    found = np.empty(len(points), dtype=np.int64)
    for k in range(len(points)):
        found[k] = line_towards(Outline(lines, sectors), points[k, 0], points[k, 1])
    return found


@settings(deadline=None, max_examples=150)
@given(seed=seeds, is_crowded=st.booleans())
def test_a_line_is_found_by_its_direction(seed, is_crowded):
    rng = np.random.default_rng(seed)
    bearings, ends = scan_of(rng)
    if is_crowded:  # so that many ends are in one sector
        bearings = 0.01 * bearings + rng.uniform(-3.1, 3.1)
        ends = np.hypot(*ends.T)[:, None] * np.column_stack((np.cos(bearings), np.sin(bearings)))
    lines, sectors = lines_of(bearings, ends, MAX_GAP), places_in_sectors(ends)
    towards = rng.uniform(-math.pi, math.pi, 200)
    if is_crowded:
        towards[::2] = rng.uniform(bearings[0] - 0.01, bearings[-1] + 0.01, 100)
    towards = np.arctan2(np.sin(towards), np.cos(towards))
    points = rng.uniform(0.1, 9.0, (200, 1)) * np.column_stack((np.cos(towards), np.sin(towards)))

    found = lines_towards(lines, sectors, points)

    expected = [sum(bearing <= each for bearing in bearings) for each in towards]
    assert found.tolist() == expected


@settings(deadline=None, max_examples=60)
@given(seed=seeds)
def test_lines_connect_neighbours(seed):
    bearings, ends = scan_of(np.random.default_rng(seed))

    lines = lines_of(bearings, ends, MAX_GAP)

    np.testing.assert_array_equal(lines[1:, :2], ends)
    for k in range(len(ends) + 1):
        if 0 < k < len(ends) and bearings[k] - bearings[k - 1] < MAX_GAP:
            along = ends[k] - ends[k - 1]
            np.testing.assert_allclose(lines[k, 2:], along / math.hypot(*along), atol=1e-12)
        else:
            assert np.isnan(lines[k, 2:]).all()


@settings(deadline=None, max_examples=60)
@given(seed=seeds, is_reversed=st.booleans())
def test_an_outline_is_traced_from_its_scanner(seed, is_reversed):
    rng = np.random.default_rng(seed)
    bearings, ends = scan_of(rng)
    if is_reversed:
        bearings, ends = bearings[::-1], ends[::-1]
    tf_tracking_sensor = Pose(*rng.uniform(-1.0, 1.0, 3).tolist())
    points = transform_points(tf_tracking_sensor, ends)
    found_bearings, found_ends = np.empty(len(points)), np.empty((len(points), 2))

    ascends = trace_outline(points, inverse(tf_tracking_sensor)[:], found_bearings, found_ends)

    assert ascends is not is_reversed
    np.testing.assert_allclose(found_ends, ends, atol=1e-9)
    np.testing.assert_allclose(found_bearings, bearings, atol=1e-9)
