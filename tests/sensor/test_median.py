# SPDX-License-Identifier: Apache-2.0
"""The median and other quantiles are those of NumPy."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.sensor.median import median, quantile


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40))
def test_it_is_the_same_number(values):
    assert median(np.array(values)) == np.median(values)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40), st.floats(0.0, 1.0))
def test_quantiles_are_the_same_numbers(values, share):
    assert quantile(np.array(values), share) == np.quantile(np.array(values), share)
