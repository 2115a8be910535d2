# SPDX-License-Identifier: Apache-2.0
"""An array that rows can be appended to in amortised constant time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

_FIRST_ROWS = 16
"""Capacity to begin with."""


class GrowingArray:
    """Rows of one shape and dtype; capacity doubles, so n appends cost O(n)."""

    def __init__(self, row_shape: tuple[int, ...], dtype: DTypeLike) -> None:
        self._buffer: NDArray[Any] = np.empty((_FIRST_ROWS, *row_shape), dtype=dtype)
        self._size = 0

    def __len__(self) -> int:
        return self._size

    @property
    def view(self) -> NDArray[Any]:
        """The rows so far, writable, shape (len(self), ...).

        Valid until the next append, which may allocate another array. An earlier view keeps its
        rows, but writing to it has no effect then.
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
        """Add rows without content yet at the end; return them, shape (count, ...)."""
        first = self._size
        self._reserve(first + count)
        self._size = first + count
        return self._buffer[first : self._size]

    def shorten(self, size: int) -> None:
        """Keep the first rows only. Earlier views keep their content, but are detached."""
        self._buffer = self._buffer[: min(size, self._size)].copy()
        self._size = len(self._buffer)

    def _reserve(self, size: int) -> None:
        if size <= len(self._buffer):
            return
        capacity = max(size, 2 * len(self._buffer), _FIRST_ROWS)
        grown = np.empty((capacity, *self._buffer.shape[1:]), self._buffer.dtype)
        grown[: self._size] = self._buffer[: self._size]
        self._buffer = grown
