# SPDX-License-Identifier: Apache-2.0
"""Rows of numbers that are read all at once, if ever, packed without loss.

Of the poses of a robot that stands, sign, exponent and the upper half of the digits are the same.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

BLOCK = 4096
"""Number of rows that are packed together."""


class PackedRows:
    """Rows of a number of columns, float64, to which rows can be appended.

    One thread may append while another reads what was there before.
    """

    def __init__(self, num_columns: int) -> None:
        self._num_columns = num_columns
        # Replaced as one, for readers in other threads.
        self._packed_and_open: tuple[tuple[bytes, ...], NDArray[np.float64]] = (
            (),
            self._empty(BLOCK),
        )
        self._size = 0

    def __len__(self) -> int:
        return self._size

    def append(self, row: Iterable[float]) -> None:
        """Add one row at the end."""
        packed, rows = self._packed_and_open
        number = self._size % BLOCK
        rows[number] = tuple(row)
        self._size += 1
        if number + 1 == BLOCK:
            self._packed_and_open = (*packed, _packed(rows)), self._empty(BLOCK)

    def extend(self, rows: NDArray[np.float64]) -> None:
        """Add rows, shape (n, number of columns), at the end."""
        for row in rows.tolist():
            self.append(row)

    def rows(self, count: int) -> NDArray[np.float64]:
        """Return the first `count` rows, shape (count, number of columns)."""
        packed, last = self._packed_and_open
        found = self._empty(count)
        for first in range(0, count, BLOCK):
            number = first // BLOCK
            block = _unpacked(packed[number], self._num_columns) if number < len(packed) else last
            found[first : first + BLOCK] = block[: count - first]
        return found

    def _empty(self, count: int) -> NDArray[np.float64]:
        return np.empty((count, self._num_columns))


def _packed(rows: NDArray[np.float64]) -> bytes:
    """Return rows as compressed bytes: the first byte of all numbers, then the second, ..."""
    columns = np.ascontiguousarray(rows.T)
    return zlib.compress(columns.view(np.uint8).reshape(-1, columns.itemsize).T.tobytes(), 1)


def _unpacked(packed: bytes, num_columns: int) -> NDArray[np.float64]:
    """Return the rows of a block."""
    planes = np.frombuffer(zlib.decompress(packed), dtype=np.uint8).reshape(8, -1)
    columns: NDArray[np.float64] = np.ascontiguousarray(planes.T).view(np.float64)
    return columns.reshape(num_columns, -1).T
