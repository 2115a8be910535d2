# SPDX-License-Identifier: Apache-2.0
"""The median is that of NumPy."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.sensor.median import median


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40))
def test_it_is_the_same_number(values):
    assert median(np.array(values)) == np.median(values)
