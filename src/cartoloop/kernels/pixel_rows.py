# SPDX-License-Identifier: Apache-2.0
"""Sets of pixels as rows of bits, 32 pixels a word, and as runs along the rows.

A set has shape (num_rows, num_words), uint32; pixel (column, row) is bit ``column % 32`` of word
``[row, column // 32]``. Arithmetic is in int64, where no bit of a word is the sign.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.arrays import CellArray

PixelRows = NDArray[np.uint32]
RunArray = CellArray

_SHIFT = 5
"""Binary logarithm of the bits in a word."""

_LAST_BIT = 31
"""Number of a word's last bit, and mask of a pixel's bit number."""

_ALL = (1 << 32) - 1
"""A word of ones."""

_DE_BRUIJN = 0x077CB531
"""A de Bruijn sequence: times a power of two, its top five bits differ for each power."""

_BIT_OF_TOP = np.zeros(32, dtype=np.int64)
for _bit in range(32):
    _BIT_OF_TOP[((_DE_BRUIJN << _bit) & _ALL) >> 27] = _bit


@kernel
def words_across(num_cols: int) -> int:
    """Return how many words a row needs, with at least one bit to spare at its end."""
    return (num_cols >> _SHIFT) + 1


@kernel
def add_span(out_rows: PixelRows, row: int, first_col: int, last_col: int) -> None:
    """Put the pixels of a row from first to last (inclusive) into the set."""
    first, last = first_col >> _SHIFT, last_col >> _SHIFT
    from_first = (_ALL << (first_col & _LAST_BIT)) & _ALL
    to_last = _ALL >> (_LAST_BIT - (last_col & _LAST_BIT))
    if first == last:
        out_rows[row, first] |= from_first & to_last
        return
    out_rows[row, first] |= from_first
    for w in range(first + 1, last):
        out_rows[row, w] = _ALL
    out_rows[row, last] |= to_last


@kernel
def pixels_across(rows: PixelRows) -> int:
    """Return how many columns there is room for, with the bit to spare left out."""
    return int((rows.shape[1] << _SHIFT) - 1)


@kernel
def has_pixel(rows: PixelRows, col: int, row: int) -> bool:
    """Return whether a pixel is in the set."""
    return bool(np.int64(rows[row, col >> _SHIFT]) >> (col & _LAST_BIT) & 1)


@kernel
def remove_pixel(out_rows: PixelRows, col: int, row: int) -> bool:
    """Take a pixel out of the set; return whether it was in."""
    bit = 1 << (col & _LAST_BIT)
    word = np.int64(out_rows[row, col >> _SHIFT])
    out_rows[row, col >> _SHIFT] = word & ~bit
    return bool(word & bit)


@kernel
def list_runs(rows: PixelRows, out_runs: RunArray) -> int:
    """Write the runs of a set of pixels into `out_runs`; return how many.

    Parameters
    ----------
    rows : the set; the last bit of each row is not in it.
    out_runs : int32, shape (n, 3): row, first column, column after the last; n is large enough.
    """
    num_edges = 0
    for row in range(rows.shape[0]):
        last: int = 0  # whether the pixel before the word is in the set
        for w in range(rows.shape[1]):
            word = np.int64(rows[row, w])
            edges = (word ^ (word << 1 | last)) & _ALL
            last = int(word >> _LAST_BIT)
            while edges != 0:
                lowest = edges & -edges
                bit = _BIT_OF_TOP[((lowest * _DE_BRUIJN) & _ALL) >> 27]
                out_runs[num_edges >> 1, 0] = row
                out_runs[num_edges >> 1, 1 + (num_edges & 1)] = (w << _SHIFT) + bit
                num_edges += 1
                edges ^= lowest
    return num_edges >> 1
