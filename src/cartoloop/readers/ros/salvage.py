# SPDX-License-Identifier: Apache-2.0
"""Reading a recording from the front: the common part of all container formats.

The library needs the index, which recorders write last. Where it is lost, the records are read one
by one as far as they are sound. `rosbag reindex` and `mcap recover` restore such files too, but
need ROS or a download, and a robot that lost power should be mapped without either. The price is
these three modules.
"""

from __future__ import annotations

import bz2
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import BinaryIO

from cartoloop.readers.ros.container import BagFinding, Channel

LARGEST_RECORD = 1 << 31
"""Longer records are nonsense [bytes]: lengths come from damaged data, memory is finite."""

_PIECE = 1024
"""Compressed data are unpacked in pieces of this size [bytes]: a fault costs one piece."""

RecordedMessage = tuple[int, int, bytes]


class CutError(Exception):
    """The file ends, or its records are not valid from here on."""


def exactly(file: BinaryIO, size: int) -> bytes:
    """Return the next `size` bytes of a file.

    Raises
    ------
    CutError
        The file ends before.
    """
    if size > LARGEST_RECORD:
        raise CutError("a record has an impossible length")
    data = file.read(size)
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
        counts: dict[int, int] = {}
        for key, _, _ in self._records(None):
            counts[key] = counts.get(key, 0) + 1
        self._found = {k: c._replace(num_messages=counts.get(k, 0)) for k, c in self._found.items()}
        self.channels = list(self._found.values())

    def messages(self, keys: Collection[int]) -> Iterator[RecordedMessage]:
        """Yield key, time of recording [ns] and bytes, in the order of recording. Never raises."""
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
        unpack: Callable[[bytes], bytes]
        if compression == "bz2":
            unpack = bz2.BZ2Decompressor().decompress
        elif compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor

            unpack = LZ4FrameDecompressor().decompress
        elif compression == "zstd":
            from cartoloop.readers.ros.zstd import zstd

            unpack = zstd.ZstdDecompressor().decompress
        else:
            raise CutError(f"a chunk has an unknown compression {compression!r}")
        plain, damaged = _unpack_pieces(unpack, packed)
        if damaged:
            self.damage = "a chunk is damaged"
        return plain

    @abstractmethod
    def _records(self, keys: frozenset[int] | None) -> Iterator[RecordedMessage]:
        """Yield the messages; without `keys` all, noting channels, and without their bytes."""


def _unpack_pieces(unpack: Callable[[bytes], bytes], packed: bytes) -> tuple[bytes, bool]:
    """Return the part of compressed data before any damage, and whether there is damage."""
    plain = []
    for start in range(0, len(packed), _PIECE):
        try:
            plain.append(unpack(packed[start : start + _PIECE]))
        except Exception:  # noqa: BLE001 - each compression raises its own
            return b"".join(plain), True
    return b"".join(plain), False
