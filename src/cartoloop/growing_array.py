# SPDX-License-Identifier: Apache-2.0
"""An array that rows can be appended to in amortised constant time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray


class GrowingArray:
    """Rows of one shape and dtype; capacity doubles, so that n appends cost O(n)."""

    def __init__(self, row_shape: tuple[int, ...], dtype: DTypeLike) -> None:
        self._buffer: NDArray[Any] = np.empty((16, *row_shape), dtype=dtype)
        self._size = 0

    def __len__(self) -> int:
        return self._size

    @property
    def view(self) -> NDArray[Any]:
        """The rows so far, writable, shape (len(self), ...).

        After the next append it may be another array: what is written into this one is lost then,
        but it keeps the rows that it has.
        """
        return self._buffer[: self._size]

    def append(self, row: ArrayLike) -> None:
        """Add one row at the end."""
        if self._size == len(self._buffer):
            self._reserve(self._size + 1)
        self._buffer[self._size] = row
        self._size += 1

    def extend(self, rows: NDArray[Any]) -> None:
        """Add rows, of shape (n, ...), at the end."""
        end = self._size + len(rows)
        self._reserve(end)
        self._buffer[self._size : end] = rows
        self._size = end

    def grow(self, count: int) -> NDArray[Any]:
        """Add rows with nothing in them yet at the end; return them, shape (count, ...)."""
        first = self._size
        self._reserve(first + count)
        self._size = first + count
        return self._buffer[first : self._size]

    def _reserve(self, size: int) -> None:
        if size <= len(self._buffer):
            return
        grown = np.empty(
            (max(size, 2 * len(self._buffer)), *self._buffer.shape[1:]), self._buffer.dtype
        )
        grown[: self._size] = self._buffer[: self._size]
        self._buffer = grown
