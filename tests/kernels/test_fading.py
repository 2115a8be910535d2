# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from cartoloop.kernels.fading import clear_inside, fade_submap, hand_over, review_walls
from tests.reference.naive_fading import (
    naive_clear,
    naive_fade,
    naive_hand_over,
    naive_review,
)

CELLS = st_numpy.arrays(np.uint8, st.tuples(st.integers(1, 8), st.integers(1, 8)))
PLACE = st.floats(-4, 10)
ANGLE = st.floats(-math.pi, math.pi)


def _affine(x, y, theta):
    return np.array([x, math.cos(theta), -math.sin(theta), y, math.sin(theta), math.cos(theta)])


@settings(max_examples=50, deadline=None)
@given(CELLS, PLACE, PLACE, ANGLE, st.integers(0, 2**32 - 1))
def test_fading_equals_its_slow_twin(cells, x, y, theta, seed):
    rng = np.random.default_rng(seed)
    total = rng.normal(0.0, 2.0, (9, 11)).astype(np.float32)
    known = rng.random((9, 11)) < 0.7
    faded, left = np.full_like(cells, 7), np.full_like(cells, 7)
    affine = _affine(x, y, theta)

    counts = fade_submap(cells, affine, total, known, -0.8, 1.6, -1.7, 3.4, faded, left)

    expected = naive_fade(cells, affine, total, known, (-0.8, 1.6), (-1.7, 3.4))
    assert np.array_equal(faded, expected[0])
    assert np.array_equal(left, expected[1])
    assert counts == expected[2:]


@settings(max_examples=50, deadline=None)
@given(CELLS, PLACE, PLACE, ANGLE, st.integers(1, 2), st.integers(0, 2**32 - 1))
def test_reviewing_equals_its_slow_twin(cells, x, y, theta, reach, seed):
    rng = np.random.default_rng(seed)
    # In steps that add up exactly, whatever their order.
    total = np.where(rng.random((9, 11)) < 0.02, 1, rng.integers(-8, 1, (9, 11)) / 8)
    total = np.where(rng.random((9, 11)) < 0.5, 0, total).astype(np.float32)
    faded = np.where(rng.random(cells.shape) < 0.7, cells, 0).astype(np.uint8)
    left, affine = np.where(rng.random(cells.shape) < 0.7, faded, 0), _affine(x, y, theta)
    left = left.astype(np.uint8)

    expected = naive_review(cells, affine, total, -1.0, reach, (2, 3), faded, left)
    review_walls(cells, affine, total, -1.0, reach, 2, 3, faded, left)

    assert np.array_equal(faded, expected[0])
    assert np.array_equal(left, expected[1])


@settings(max_examples=50, deadline=None)
@given(CELLS, CELLS, PLACE, PLACE, ANGLE)
def test_handing_over_equals_its_slow_twin(source, cells, x, y, theta):
    affine = _affine(x, y, theta)
    filled, taken = cells.copy(), np.full_like(cells, 7)
    sums = np.add.outer(np.arange(256), np.arange(256)).astype(np.uint8)

    count = hand_over(affine, source, sums, filled, taken)

    expected = naive_hand_over(affine, source, sums, cells)
    assert np.array_equal(filled, expected[0])
    assert np.array_equal(taken, expected[1])
    assert count == np.count_nonzero(taken)


@settings(max_examples=50, deadline=None)
@given(CELLS, st.integers(0, 6), st.integers(0, 6), PLACE, PLACE, ANGLE)
def test_clearing_equals_its_slow_twin(cells, rows, cols, x, y, theta):
    affine, left = _affine(x, y, theta), cells.copy()

    clear_inside(affine, rows, cols, left)

    assert np.array_equal(left, naive_clear(affine, (rows, cols), cells))
