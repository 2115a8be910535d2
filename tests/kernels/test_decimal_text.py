# SPDX-License-Identifier: Apache-2.0
"""Numbers read out of text are those that Python reads, to the last bit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.decimal_text import POWERS_OF_TEN, parse_decimals
from tests.reference import naive_decimal_text

words = st.one_of(
    st.floats(-1e6, 1e6).map(lambda value: f"{value:.3f}"),
    st.decimals(allow_nan=False, allow_infinity=False, places=9).map(str),
    st.integers().map(str),
    st.text("0123456789.+-", min_size=1, max_size=17),
    st.sampled_from(["nan", "inf", "1e3", "-", ".", "-0.0", "+.5", "5.", "1_0", "0x1"]),
)


@settings(deadline=None)
@given(st.lists(words, max_size=5), st.sampled_from([" ", "  ", "\t", " \r\n"]), st.integers(0, 5))
def test_numbers_are_those_that_python_reads(parts, blank, count):
    text = (blank + blank.join(parts)).encode()
    values = np.full(count, np.nan)
    end = parse_decimals(text, POWERS_OF_TEN, values)
    expected = naive_decimal_text.parse_decimals(text, count)
    if expected is None:
        assert end == -1
        return
    assert values.tolist() == expected
    assert [math.copysign(1.0, v) for v in values] == [math.copysign(1.0, v) for v in expected]
    assert text[end:].split() == [part.encode() for part in parts[count:]]


@pytest.mark.parametrize(
    "text", ["1.0", "1.0 2.0x", "1.0 2.0.0", "1.0 --2", "1.0 1234567890123456"]
)
def test_missing_or_malformed_number_gives_minus_one(text):
    assert parse_decimals(text.encode(), POWERS_OF_TEN, np.empty(2)) == -1
