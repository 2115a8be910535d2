# SPDX-License-Identifier: Apache-2.0
"""Rows of CSV text, against Python's own formatting."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.csv_rows import MAX_DIGITS, write_number, write_rows


def written(value, decimals):
    text = np.zeros(MAX_DIGITS, np.uint8)
    return text[: write_number(value, decimals, text, 0)].tobytes().decode()


@settings(deadline=None)
@given(value=st.floats(-1e9, 1e9), decimals=st.integers(0, 8))
def test_numbers_have_fixed_decimals(value, decimals):
    text = written(value, decimals)

    assert float(text) == pytest.approx(value, abs=0.5001 * 10.0**-decimals, rel=1e-12)
    assert len(text.partition(".")[2]) == decimals


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [
        (0.0, 0, "0"), (-0.0, 2, "0.00"), (-0.004, 2, "0.00"), (0.25, 3, "0.250"),
        (12.0, 1, "12.0"), (-3.5, 1, "-3.5"), (0.05, 1, "0.0"), (math.nan, 2, ""),
        (math.inf, 2, ""), (1e300, 0, "900000000000000000"), (-1e300, 5, "-9000000000000.00000"),
    ],
)  # fmt: skip
def test_special_numbers_are_written(value, decimals, text):
    assert written(value, decimals) == text


def test_rows_hold_words_and_numbers():
    words = ["", "one", "other"]
    bounds = np.concatenate(([0], np.cumsum([len(word) for word in words])))
    out = np.zeros(200, np.uint8)
    size = write_rows(
        np.frombuffer("".join(words).encode(), np.uint8),
        bounds,
        np.array([(1, 0), (2, 1)]),
        np.array([(1.0, math.nan), (-2.0, 0.126)]),
        np.array((0, 2)),
        out,
    )

    assert out[:size].tobytes().decode() == "one,,1,\nother,one,-2,0.13\n"
