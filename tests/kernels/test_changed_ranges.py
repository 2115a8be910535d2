# SPDX-License-Identifier: Apache-2.0
"""Changed ranges, against a slow and obvious reference."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.kernels.changed_ranges import any_changed

CHANGE, MAX_BEFORE, MAX_NOW = (0.05, 0.03, 4.0), 8.0, 9.0


def naive_any_changed(before, now, noise):
    for one, other in zip(before, now, strict=True):
        are_returns = 0.0 < one < MAX_BEFORE and 0.0 < other < MAX_NOW
        nearer = min(one, other)
        limit = CHANGE[0] + CHANGE[1] * nearer
        limit += CHANGE[2] * math.hypot(noise[0], noise[1] * nearer)
        if are_returns and abs(one - other) > limit:
            return True
    return False


ranges = st.one_of(st.floats(-1.0, 10.0), st.sampled_from([math.nan, math.inf, 0.0, 8.0, 9.0]))
steps = st.one_of(st.floats(-0.6, 0.6), st.sampled_from([math.nan, 5.0]))
noises = st.tuples(st.floats(0.0, 0.1), st.floats(0.0, 0.05))


@given(st.lists(st.tuples(ranges, steps), max_size=20), noises)
def test_returns_that_differ_by_more_than_noise_count(values, noise):
    before = np.array([value for value, _ in values], dtype=float)
    now = before + np.array([step for _, step in values], dtype=float)
    found = any_changed(before, now, MAX_BEFORE, MAX_NOW, CHANGE, noise)
    assert found == naive_any_changed(before.tolist(), now.tolist(), noise)
