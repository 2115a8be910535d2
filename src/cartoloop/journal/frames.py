# SPDX-License-Identifier: Apache-2.0
"""The format of a journal: records in frames, each with its length and checksum.

A file begins with `MAGIC` and the version of the format (uint32). A frame is what was written at
once: the length of its content and the CRC-32 of it (uint32 each), then the content, which are
records: kind (uint8), length (uint32), payload. All numbers are little-endian. A kill or a loss of
power can cut off the last frames. The journal ends before the first that is not whole.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

from cartoloop.errors import InputError

FILE_NAME = "journal.cartoloop"

FORMAT_VERSION = 1
"""Increased when older programs could not read a journal."""

MAGIC = b"cartoloop run\r\n\x1a"
"""Line ends of two kinds, so that a transfer as text is noticed."""

PREAMBLE = MAGIC + struct.pack("<I", FORMAT_VERSION)

_FRAME, _RECORD = struct.Struct("<II"), struct.Struct("<BI")


class Kind(IntEnum):
    """What a record holds; the payloads are described in docs/map-file.md."""

    HEADER = 0
    """JSON: the run, see `runs.journal`."""
    CALIBRATION = 1
    """JSON: what the first pass over the recording found out about the sensors, or null."""
    MATCH = 2
    """Of a scan to the older active submap (`local_slam/match_records.py`)."""
    WALL_STEP = 3
    """Comparison of a scan with the one before (`local_slam/match_records.py`)."""
    SCAN = 4
    """Stamp and pose of a mapped scan (`node_records.py`)."""
    NODE = 5
    """A scan that became a node (`node_records.py`)."""
    SUBMAP = 6
    """The grid of a finished submap (`global_slam/graph_records.py`), as are all that follow."""
    REQUESTS = 7
    """Pairs that are to be searched."""
    DROPPED = 8
    """Requests that are not, because too many were waiting."""
    SEARCHED = 9
    """What searches came to, when it joined the record of closures."""
    WIDE_SEARCHED = 10
    """The same of composite scans."""
    BELIEVED = 11
    """Closures of hypotheses that agree."""
    POSES = 12
    """Poses of the submaps after an adjustment."""
    JOIN_SEARCHED = 13
    """What searches of parts of the map in each other came to (`global_slam/join_records.py`)."""
    JOIN_DECIDED = 14
    """Whether two parts were joined, where, and by which closures."""


LOCAL_KINDS = frozenset({Kind.CALIBRATION, Kind.MATCH, Kind.WALL_STEP, Kind.SCAN, Kind.NODE})
"""Kinds that come from the thread of local SLAM; the others come from that of the graph."""


class Record(NamedTuple):
    """A record; `payload` is a part of the file."""

    kind: int
    payload: memoryview


class Content(NamedTuple):
    """What a journal holds.

    Attributes
    ----------
    records : in the order in which they were written.
    size : of the file up to the end of the last whole frame [bytes].
    """

    records: list[Record]
    size: int


def record_bytes(kind: int, payload: bytes) -> bytes:
    """Return a record as a part of a frame's content."""
    return _RECORD.pack(kind, len(payload)) + payload


def frame_bytes(records: Iterable[bytes]) -> bytes:
    """Return the frame of some records."""
    content = b"".join(records)
    return _FRAME.pack(len(content), zlib.crc32(content)) + content


def read_content(path: Path, max_frames: int | None = None) -> Content:
    """Return the content of a journal up to the last whole frame.

    Parameters
    ----------
    max_frames : number of frames to read; None: all.

    Raises
    ------
    InputError
        It cannot be read, is no journal, or is of a newer program.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    if not data.startswith(MAGIC) or len(data) < len(PREAMBLE):
        raise InputError(f"{path}: is no journal of a run; remove it, and map the recording again")
    [version] = struct.unpack_from("<I", data, len(MAGIC))
    if version > FORMAT_VERSION:
        raise InputError(
            f"{path}: is of version {version}, this program knows {FORMAT_VERSION}; use the "
            "program that wrote it, or map the recording again"
        )
    return _content(memoryview(data), max_frames)


def _content(data: memoryview, max_frames: int | None) -> Content:
    records: list[Record] = []
    place, num_frames = len(PREAMBLE), 0
    while num_frames != max_frames and place + _FRAME.size <= len(data):
        length, checksum = _FRAME.unpack_from(data, place)
        content = data[place + _FRAME.size : place + _FRAME.size + length]
        if len(content) != length or zlib.crc32(content) != checksum:
            break
        found = _records(content)
        if found is None:
            break
        records += found
        place += _FRAME.size + length
        num_frames += 1
    return Content(records, place)


def _records(content: memoryview) -> list[Record] | None:
    """Return the records of a frame, None if their lengths do not add up to its own."""
    records, place = [], 0
    while place < len(content):
        if place + _RECORD.size > len(content):
            return None
        kind, length = _RECORD.unpack_from(content, place)
        place += _RECORD.size
        payload = content[place : place + length]
        if len(payload) != length:
            return None
        records.append(Record(kind, payload))
        place += length
    return records
