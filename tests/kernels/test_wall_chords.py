# SPDX-License-Identifier: Apache-2.0
"""Chords along walls, against a slow and obvious reference."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.kernels.wall_chords import chord_ends

LENGTH, GAP = 0.5, 1.2


def naive_chord_ends(returns, max_returns):
    ends = [0] * len(returns)
    for first in range(len(returns)):
        for last in range(first + 1, min(first + max_returns, len(returns))):
            if math.dist(returns[last - 1], returns[last]) >= GAP:
                break
            if math.dist(returns[first], returns[last]) >= LENGTH:
                ends[first] = last
                break
    return ends


@given(st.integers(0, 1000), st.integers(0, 50), st.floats(0.05, 0.6), st.integers(1, 20))
def test_chords_end_at_the_first_far_return(seed, count, step, max_returns):
    steps = np.random.default_rng(seed).normal(0.0, step, (count, 2))
    returns = np.cumsum(steps, axis=0).reshape(-1, 2)
    ends = chord_ends(returns, LENGTH, max_returns, GAP)
    assert ends.tolist() == naive_chord_ends(returns.tolist(), max_returns)
