# SPDX-License-Identifier: Apache-2.0
"""Reading a recording from the front: what that has in common, whatever its format.

The library needs the index, which recorders write last. Where it is lost, the records are followed
one by one as far as they go.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import BinaryIO

from cartoloop.readers.ros.container import Channel
from cartoloop.readers.ros.inventory import BagFinding

LARGEST_RECORD = 1 << 31
_PIECE = 1024

Record = tuple[int, int, bytes]


class CutError(Exception):
    """The file ends, or makes no sense any more."""


def exactly(file: BinaryIO, size: int) -> bytes:
    """Return the next `size` bytes of a file.

    Raises
    ------
    CutError
        There are no more so many.
    """
    if size > LARGEST_RECORD:
        raise CutError("a record has an impossible length")
    data = file.read(size)
    if len(data) < size:
        raise CutError("the file is cut off")
    return data


class Scanned(ABC):
    """What the readers of this module share: one pass that finds the channels and counts."""

    def __init__(self, path: Path, kind: str) -> None:
        self.kind = kind
        self.path = path
        self.damage = ""
        self.notes: list[BagFinding] = []
        self.needs: object = None
        self._found: dict[int, Channel] = {}
        counts: dict[int, int] = {}
        for key, _, _ in self._records(None):
            counts[key] = counts.get(key, 0) + 1
        self._found = {k: c._replace(num_messages=counts.get(k, 0)) for k, c in self._found.items()}
        self.channels = list(self._found.values())

    def messages(self, keys: Collection[int]) -> Iterator[Record]:
        """Yield key, time of recording [ns] and bytes, in the order of recording. Never raises."""
        yield from self._records(frozenset(keys))

    @abstractmethod
    def _records(self, keys: frozenset[int] | None) -> Iterator[Record]:
        """Yield the messages; without `keys` all, noting channels, and without their bytes."""


def unpack_as_far(unpack: Callable[[bytes], bytes], packed: bytes) -> tuple[bytes, bool]:
    """Return what of compressed data can be unpacked, and whether something in it is damaged."""
    plain = []
    for start in range(0, len(packed), _PIECE):
        try:
            plain.append(unpack(packed[start : start + _PIECE]))
        except Exception:  # noqa: BLE001 - each compression raises its own
            return b"".join(plain), True
    return b"".join(plain), False
