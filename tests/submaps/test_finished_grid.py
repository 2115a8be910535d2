# SPDX-License-Identifier: Apache-2.0
"""Probabilities in a byte: what is lost, and what is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.submaps.finished_grid import (
    MAX_PROBABILITY,
    MIN_PROBABILITY,
    PROBABILITY_STEP,
    FinishedGrid,
    kept_cells,
    mean_probability,
    mean_value,
    quantize_probabilities,
)

probabilities = st.floats(MIN_PROBABILITY, MAX_PROBABILITY)


def dequantized(values):
    return FinishedGrid(values, 0.0, 0.0, 0.05).probabilities()


@settings(deadline=None, max_examples=100)
@given(st.lists(probabilities, min_size=1, max_size=20))
def test_quantisation_errs_by_no_more_than_half_a_step(exact):
    exact = np.array([exact], dtype=np.float32)
    error = np.abs(dequantized(quantize_probabilities(exact)) - exact)
    assert error.max() <= 0.5 * PROBABILITY_STEP + 1e-6


def test_every_cell_value_survives_the_round_trip():
    values = np.arange(256, dtype=np.uint8).reshape(16, 16)
    assert np.array_equal(quantize_probabilities(dequantized(values)), values)


def test_the_clamping_limits_are_the_extreme_values():
    limits = np.array([[MIN_PROBABILITY, MAX_PROBABILITY]], dtype=np.float32)
    assert quantize_probabilities(limits).tolist() == [[1, 255]]
    assert dequantized(np.array([[1, 255]], np.uint8))[0] == pytest.approx(limits[0])


def test_unknown_cells_stay_unknown():
    assert quantize_probabilities(np.zeros((2, 3), np.float32)).tolist() == [[0, 0, 0], [0, 0, 0]]
    assert dequantized(np.zeros((2, 3), np.uint8)).tolist() == [[0.0] * 3] * 2


@settings(deadline=None, max_examples=60)
@given(a=probabilities, b=probabilities)
def test_quantisation_keeps_the_order(a, b):
    low, high = sorted((a, b))
    values = quantize_probabilities(np.array([[low, high]], dtype=np.float32))[0]
    assert values[0] <= values[1]


@settings(deadline=None, max_examples=60)
@given(st.lists(st.integers(1, 255), min_size=1, max_size=30))
def test_mean_values_correspond_to_mean_probabilities(values):
    values = np.array([values], dtype=np.uint8)
    expected = float(dequantized(values).mean(dtype=np.float64))
    assert mean_probability(float(values.mean())) == pytest.approx(expected, abs=1e-6)


@settings(deadline=None, max_examples=60)
@given(score=st.floats(MIN_PROBABILITY, MAX_PROBABILITY))
def test_scores_and_mean_values_are_inverse(score):
    assert mean_probability(mean_value(score)) == pytest.approx(score)


def test_no_score_is_negative():
    assert mean_probability(0.0) >= 0.0
    assert mean_probability(-1e3) == 0.0


def test_cells_are_kept_as_far_as_memory_allows():
    rng = np.random.default_rng(3)
    values = [rng.integers(0, 256, (20, 30)).astype(np.uint8) for _ in range(3)]
    grids = [FinishedGrid(cells, 0.0, 0.0, 0.05) for cells in values]
    with kept_cells(grids, max_bytes=2 * 600):
        assert [grid.cells is grid.cells for grid in grids] == [True, True, False]
        assert all(np.array_equal(g.cells, cells) for g, cells in zip(grids, values, strict=True))
    assert not any(grid.cells is grid.cells for grid in grids)


def test_cells_are_not_kept_after_an_error():
    grid = FinishedGrid(np.ones((2, 2), dtype=np.uint8), 0.0, 0.0, 0.05)
    with pytest.raises(RuntimeError), kept_cells([grid]):
        raise RuntimeError
    assert grid.cells is not grid.cells
