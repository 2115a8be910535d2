# SPDX-License-Identifier: Apache-2.0
"""Arrays as bytes: their shapes first, then their content; the reader knows the types."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_COUNT = struct.Struct("<I")


def pack_columns(columns: Sequence[NDArray[Any]], types: Sequence[str]) -> bytes:
    """Return columns of one length as bytes: their length (uint32), then one after the other.

    Parameters
    ----------
    columns : each of shape (n, ...).
    types : of each, little-endian, as numpy names it: ``<f8``, ``<i4``, ``i1``.
    """
    parts = [_COUNT.pack(len(columns[0]))]
    for column, kind in zip(columns, types, strict=True):
        parts.append(np.ascontiguousarray(column, dtype=kind).tobytes())
    return b"".join(parts)


class FieldReader:
    """Reads a payload from its beginning.

    Every method raises ValueError or struct.error where the payload is too short.
    """

    def __init__(self, payload: memoryview) -> None:
        self._payload = payload
        self._place = 0

    @property
    def is_at_end(self) -> bool:
        """Whether all was read."""
        return self._place >= len(self._payload)

    def numbers(self, layout: struct.Struct) -> tuple[Any, ...]:
        """Return numbers of a fixed layout."""
        values = layout.unpack_from(self._payload, self._place)
        self._place += layout.size
        return values

    def array(self, kind: str, shape: tuple[int, ...]) -> NDArray[Any]:
        """Return an array, a copy in the machine's byte order."""
        stored = np.dtype(kind)
        size = stored.itemsize
        for length in shape:
            size *= length
        if size > len(self._payload) - self._place:
            raise ValueError("a record is too short")
        content = self._payload[self._place : self._place + size]
        self._place += size
        return np.frombuffer(content, stored).reshape(shape).astype(stored.newbyteorder("="))

    def columns(
        self, types: Sequence[str], shapes: Sequence[tuple[int, ...]]
    ) -> list[NDArray[Any]]:
        """Return columns of one length, given the shapes of their rows."""
        [count] = self.numbers(_COUNT)
        return [
            self.array(kind, (count, *shape)) for kind, shape in zip(types, shapes, strict=True)
        ]

    def rest(self) -> memoryview:
        """Return the bytes that are left."""
        found = self._payload[self._place :]
        self._place = len(self._payload)
        return found
