# SPDX-License-Identifier: Apache-2.0
"""Rows of a CSV file from columns of words and numbers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

COMMA, NEWLINE, MINUS, POINT, ZERO = 44, 10, 45, 46, 48
"""ASCII."""

MAX_DIGITS = 20
"""Characters of the longest number: 18 digits, sign and point."""

LARGEST = 9e17
"""Numbers times their power of ten are clipped to this: 64-bit integers hold it."""


@kernel
def write_number(value: float, decimals: int, out_text: NDArray[np.uint8], place: int) -> int:
    """Write a number with fixed decimals at a place of a text; return where it ends.

    NaN and infinite numbers leave the field empty.
    """
    if not math.isfinite(value):
        return place
    scaled = np.rint(value * 10.0**decimals)
    number = np.int64(min(max(scaled, -LARGEST), LARGEST))
    if number < 0:
        out_text[place] = MINUS
        place += 1
        number = -number
    num_digits, rest = 1, number // 10
    while rest > 0 or num_digits <= decimals:
        num_digits += 1
        rest //= 10
    end = place + num_digits + (1 if decimals > 0 else 0)
    at = end
    for digit in range(num_digits):
        if digit == decimals and decimals > 0:
            at -= 1
            out_text[at] = POINT
        at -= 1
        out_text[at] = ZERO + number % 10
        number //= 10
    return end


@kernel
def write_rows(
    words: NDArray[np.uint8],
    word_bounds: NDArray[np.int64],
    codes: NDArray[np.int64],
    numbers: NDArray[np.float64],
    decimals: NDArray[np.int64],
    out_text: NDArray[np.uint8],
) -> int:
    """Write rows of words, then numbers, separated by commas; return how many characters.

    Parameters
    ----------
    words : uint8, shape (c,), all words one after the other, ASCII.
    word_bounds : int64, shape (w + 1,): word i is ``words[word_bounds[i] : word_bounds[i + 1]]``.
    codes : int64, shape (n, k), words of each row.
    numbers : float64, shape (n, m); NaN and infinite ones leave a field empty.
    decimals : int64, shape (m,), of each column.
    out_text : uint8, long enough.
    """
    place = 0
    for row in range(codes.shape[0]):
        for column in range(codes.shape[1]):
            word = codes[row, column]
            for i in range(word_bounds[word], word_bounds[word + 1]):
                out_text[place] = words[i]
                place += 1
            out_text[place] = COMMA
            place += 1
        for column in range(numbers.shape[1]):
            place = write_number(numbers[row, column], decimals[column], out_text, place)
            out_text[place] = COMMA
            place += 1
        out_text[place - 1] = NEWLINE
    return place
