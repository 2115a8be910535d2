# SPDX-License-Identifier: Apache-2.0
"""Compressed parts of recordings, unpacked within a budget: a few bytes may stand for gigabytes.

The library rosbags unpacks without limits. `limit_library` has it use the functions of this module.
"""

from __future__ import annotations

import bz2
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO, Protocol

MAX_CHUNK_BYTES = 128 << 20
"""Of a chunk, unpacked [bytes]: recorders begin a new one after some megabytes."""

_RATIO = 100
"""Recordings unpack to ten times their size, rarely to more."""

_FREE_BYTES = 256 << 20
"""That may be unpacked from a file of any size [bytes]."""

_PIECE = 1024
"""A damaged chunk is unpacked in pieces of this size [bytes]: a fault costs one piece."""


class BudgetError(Exception):
    """What is unpacked is larger than any recording."""


class Budget:
    """What may be unpacked in one pass over a file.

    Parameters
    ----------
    packed : size of the file [bytes].

    Attributes
    ----------
    left : that may still be unpacked; negative: more was [bytes].
    """

    def __init__(self, packed: int) -> None:
        self.left = _FREE_BYTES + _RATIO * packed

    def spend(self, num_bytes: int) -> None:
        """Note unpacked bytes.

        Raises
        ------
        BudgetError
            There are too many.
        """
        self.left = max(self.left - num_bytes, -1)
        if self.left < 0:
            raise BudgetError(f"it unpacks to more than {_RATIO} times its size")


_current: ContextVar[Budget | None] = ContextVar("budget", default=None)


@contextmanager
def spending(budget: Budget) -> Iterator[None]:
    """Have all that is unpacked in the body counted."""
    token = _current.set(budget)
    try:
        yield
    finally:
        _current.reset(token)


class _Stream(Protocol):
    """A decompressor of the standard library's kind."""

    @property
    def eof(self) -> bool:
        """Whether the stream is complete."""

    @property
    def needs_input(self) -> bool:
        """Whether more can only come of further data."""

    @property
    def unused_data(self) -> bytes:
        """What follows the stream."""

    def decompress(self, data: bytes, max_length: int = -1) -> bytes:
        """Return the next bytes, at most `max_length`."""


def _bz2() -> _Stream:
    return bz2.BZ2Decompressor()


def _lz4() -> _Stream:
    from lz4.frame import LZ4FrameDecompressor

    stream: _Stream = LZ4FrameDecompressor()
    return stream


def _zstd() -> _Stream:
    from cartoloop.readers.ros.zstd import zstd

    return zstd.ZstdDecompressor()


_STREAMS: dict[str, Callable[[], _Stream]] = {"bz2": _bz2, "lz4": _lz4, "zstd": _zstd}
KNOWN = ("", "none", *_STREAMS)
"""Names of compressions in chunks."""


def unpack(compression: str, packed: bytes) -> bytes:
    """Return an unpacked chunk.

    Raises
    ------
    BudgetError
        It is larger than `MAX_CHUNK_BYTES`, or all so far are larger than the budget.
    Exception
        Of the compression, if it is damaged.
    """
    plain = bytearray()
    for piece in _unpacked(compression, [packed]):
        plain += piece
    return bytes(plain)


def unpack_sound_part(compression: str, packed: bytes) -> tuple[bytes, str]:
    """Return the part of a chunk before any damage, and what is wrong with the rest, or ""."""
    plain = bytearray()
    pieces = [packed[start : start + _PIECE] for start in range(0, len(packed), _PIECE)]
    try:
        for piece in _unpacked(compression, pieces):
            plain += piece
    except BudgetError as error:
        return b"", str(error)
    except Exception:  # noqa: BLE001 - each compression raises its own
        return bytes(plain), "a chunk is damaged"
    return bytes(plain), ""


def _unpacked(compression: str, pieces: list[bytes]) -> Iterator[bytes]:
    """Yield unpacked pieces, which are counted; what follows the first stream may be nonsense."""
    stream, is_first = _STREAMS[compression](), True
    budget = _current.get() or Budget(sum(map(len, pieces)))
    size = 0
    for piece in pieces:
        data, is_pending = piece, False
        while data or is_pending:
            if stream.eof:
                stream, is_first = _STREAMS[compression](), False
            room = MAX_CHUNK_BYTES + 1 - size
            try:
                plain = stream.decompress(data, max(1, min(room, budget.left + 1)))
            except Exception:
                if is_first:
                    raise
                return
            size += len(plain)
            budget.spend(len(plain))
            if size > MAX_CHUNK_BYTES:
                raise BudgetError(f"a chunk unpacks to more than {MAX_CHUNK_BYTES >> 20} MB")
            yield plain
            data = stream.unused_data if stream.eof else b""
            is_pending = not (stream.eof or stream.needs_input)
    if is_first and not stream.eof:
        raise EOFError("a chunk is cut off")


def unpack_file(packed: Path, to: Path) -> None:
    """Unpack a zstd file.

    Raises
    ------
    BudgetError
        It is larger than the budget of its size; what came before is in the file.
    OSError, EOFError, ZstdError
        It cannot be read or written, or is damaged.
    """
    with packed.open("rb") as source, _open_zstd(source) as plain, to.open("wb") as out:
        while piece := plain.read(1 << 20):
            out.write(piece)


@contextmanager
def _open_zstd(packed: BinaryIO, _: str = "rb") -> Iterator[BinaryIO]:
    """Yield a zstd file for reading, within the budget of its size."""
    from cartoloop.readers.ros.zstd import zstd

    budget = Budget(os.fstat(packed.fileno()).st_size)
    with zstd.open(packed, "rb") as plain:

        def read(num_bytes: int = 1 << 20) -> bytes:
            data: bytes = plain.read(num_bytes)
            budget.spend(len(data))
            return data

        counted: Any = SimpleNamespace(read=read)
        yield counted


@cache
def limit_library() -> None:
    """Have rosbags unpack within the budget. Its tables of decompressors are not its interface."""
    from rosbags.rosbag1 import reader as ros1
    from rosbags.rosbag2 import reader as ros2
    from rosbags.rosbag2 import storage_mcap

    for table in (ros1.decompressors, storage_mcap.DECOMPRESSORS):
        for name in _STREAMS.keys() & table.keys():
            table[name] = _unpacks(name)
    reader: Any = ros2
    reader.zstd = SimpleNamespace(decompress=_unpacks("zstd"), open=_open_zstd)


def _unpacks(compression: str) -> Callable[..., bytes]:
    def unpack_chunk(packed: bytes, *_: int) -> bytes:
        return unpack(compression, packed)

    return unpack_chunk
