# SPDX-License-Identifier: Apache-2.0
"""Which way walls face, by neighbouring returns and by chords."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.sensor.wall_normals import (
    CHORD_M,
    CORRIDOR_RATIO,
    MAX_GAP_M,
    MIN_EDGES,
    chord_ratio,
    normal_ratio,
)


def corridor(sigma=0.0, end=20.0, seed=1):
    """Return what a scanner sees of a corridor 2.4 m wide that ends ahead."""
    angles = np.radians(np.arange(-180.0, 180.0, 2.0)) + 0.01
    with np.errstate(divide="ignore"):
        ahead = np.where(np.cos(angles) > 0.0, end / np.cos(angles), np.inf)
    ranges = np.minimum(1.2 / np.abs(np.sin(angles)), ahead)
    ranges *= 1.0 + sigma * np.random.default_rng(seed).normal(size=len(angles))
    points = np.column_stack((ranges * np.cos(angles), ranges * np.sin(angles)))
    return points[ranges < 5.0]


def naive_chord_ratio(points, max_range):
    near = [p for p in points.tolist() if math.hypot(*p) < max_range]
    near.sort(key=lambda p: math.atan2(p[1], p[0]))
    chords = []
    for i in range(len(near)):
        for j in range(i + 1, len(near)):
            if math.dist(near[j - 1], near[j]) >= MAX_GAP_M:
                break
            if (length := math.dist(near[i], near[j])) >= CHORD_M:
                chords.append([(b - a) / length for a, b in zip(near[i], near[j], strict=True)])
                break
    if len(chords) < MIN_EDGES:
        return 1.0
    low, high = np.linalg.eigvalsh(np.array(chords).T @ np.array(chords))
    return low / high


@given(st.integers(0, 1000), st.integers(0, 39), st.floats(0.2, 4.0))
def test_chords_end_at_the_first_return_that_is_far_enough(seed, count, size):
    points = np.random.default_rng(seed).normal(0.0, size, (count, 2))
    assert chord_ratio(points, 5.0) == pytest.approx(naive_chord_ratio(points, 5.0), abs=1e-9)


def test_noise_does_not_hide_a_corridor_from_chords():
    assert normal_ratio(corridor(), 10.0) < CORRIDOR_RATIO
    assert normal_ratio(corridor(sigma=0.04), 10.0) > CORRIDOR_RATIO
    assert chord_ratio(corridor(sigma=0.04), 10.0) < CORRIDOR_RATIO / 3.0


def test_a_wall_across_is_seen_by_both():
    points = corridor(end=2.0)
    assert normal_ratio(points, 10.0) > CORRIDOR_RATIO
    assert chord_ratio(points, 10.0) > CORRIDOR_RATIO
