# SPDX-License-Identifier: Apache-2.0
"""Quantiles and sorted orders, against NumPy and sorted()."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.kernels.order_statistics import (
    distance_quantile,
    quantile_of,
    select,
    sort_indices,
)

numbers = st.one_of(st.floats(-1e3, 1e3), st.sampled_from([0.0, 1.0, 2.0]))
sequences = st.lists(numbers, min_size=1, max_size=60)


@given(sequences, st.data())
def test_the_number_of_a_rank_is_selected(values, data):
    k = data.draw(st.integers(0, len(values) - 1))
    reordered = np.array(values)
    assert select(reordered, k) == sorted(values)[k]
    assert sorted(reordered.tolist()) == sorted(values)
    assert max(reordered[: k + 1]) <= min(reordered[k:])


@given(sequences, st.floats(0.0, 1.0))
def test_quantiles_are_those_of_numpy(values, share):
    expected = float(np.quantile(values, share))
    assert quantile_of(np.array(values), share) == pytest.approx(expected, abs=1e-9)


@given(sequences)
def test_the_middle_quantile_is_the_median(values):
    assert quantile_of(np.array(values), 0.5) == pytest.approx(float(np.median(values)), abs=1e-12)


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=40), st.floats(0.0, 1.0))
def test_distances_are_from_the_origin(points, share):
    expected = np.quantile([np.hypot(x, y) for x, y in points], share)
    assert distance_quantile(np.array(points), share) == pytest.approx(expected, rel=1e-12)


@given(st.lists(numbers, max_size=80))
def test_equal_numbers_keep_their_order(values):
    order = np.empty(len(values), dtype=np.int64)
    sort_indices(np.array(values, dtype=float), order)
    assert order.tolist() == sorted(range(len(values)), key=values.__getitem__)
