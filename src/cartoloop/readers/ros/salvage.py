# SPDX-License-Identifier: Apache-2.0
"""Reading a recording from the front: the common part of all container formats.

The library needs the index, which recorders write last. Where it is lost, the records are read one
by one as far as they are sound. `rosbag reindex` and `mcap recover` restore such files too, but
need ROS or a download, and a robot that lost power should be mapped without either. The price is
these three modules.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO

from cartoloop.readers.ros.container import BagFinding, Channel
from cartoloop.readers.ros.unpacking import KNOWN, Budget, spending, unpack_sound_part

LARGEST_RECORD = 1 << 31
"""Longer records are nonsense [bytes]: lengths come from damaged data, memory is finite."""

_READ_BYTES = 1 << 24

RecordedMessage = tuple[int, int, bytes]


class CutError(Exception):
    """The file ends, or its records are not valid from here on."""


def at_most(file: BinaryIO, size: int) -> bytes:
    """Return the next `size` bytes of a file, or those until its end.

    In pieces: memory for a length that comes from damaged data is not reserved at once.
    """
    pieces = []
    while size > 0 and (piece := file.read(min(size, _READ_BYTES))):
        pieces.append(piece)
        size -= len(piece)
    return b"".join(pieces)


def exactly(file: BinaryIO, size: int) -> bytes:
    """Return the next `size` bytes of a file.

    Raises
    ------
    CutError
        The file ends before.
    """
    if size > LARGEST_RECORD:
        raise CutError("a record has an impossible length")
    data = at_most(file, size)
    if len(data) < size:
        raise CutError("the file is cut off")
    return data


class SalvageContainer(ABC):
    """A container read from the front; a first pass finds the channels and counts messages."""

    def __init__(self, path: Path, kind: str) -> None:
        self.kind = kind
        self.path = path
        self.damage = ""
        self.notes: list[BagFinding] = []
        self.needs: object = None
        self._found: dict[int, Channel] = {}
        self._budget = Budget(path.stat().st_size)
        counts: dict[int, int] = {}
        for key, _, _ in self._records(None):
            counts[key] = counts.get(key, 0) + 1
        self._found = {k: c._replace(num_messages=counts.get(k, 0)) for k, c in self._found.items()}
        self.channels = list(self._found.values())

    def messages(self, keys: Collection[int]) -> Iterator[RecordedMessage]:
        """Yield key, time of recording [ns] and bytes, in the order of recording. Never raises."""
        self._budget = Budget(self.path.stat().st_size)
        yield from self._records(frozenset(keys))

    def _unpack(self, compression: str, packed: bytes) -> bytes:
        """Return the part of a chunk that can be unpacked; note damage.

        Raises
        ------
        CutError
            The compression is not known.
        """
        if compression in ("", "none"):
            return packed
        if compression not in KNOWN:
            raise CutError(f"a chunk has an unknown compression {compression!r}")
        with spending(self._budget):
            plain, damage = unpack_sound_part(compression, packed)
        self.damage = damage or self.damage
        return plain

    @abstractmethod
    def _records(self, keys: frozenset[int] | None) -> Iterator[RecordedMessage]:
        """Yield the messages; without `keys` all, noting channels, and without their bytes."""
