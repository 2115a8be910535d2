# SPDX-License-Identifier: Apache-2.0
"""The messages from server to page, byte by byte; ``docs/viewer-protocol.md`` is their reference.

All is little-endian. A message is a header of 8 bytes, a payload, and zeros up to a multiple of 8
bytes, so that every array in a payload lies where a browser's typed arrays can look at it in
place. A WebSocket message holds one or more of them.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Mapping
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

PROTOCOL_VERSION = 3
"""Rises when pages made for the protocol before would go wrong."""

FINISHED = 1
"""Flag of a submap that will not change any more."""

_HEADER = struct.Struct("<IHH")
_SUBMAP = struct.Struct("<6I3d")
_PREVIEW = struct.Struct("<4I3d")
_PATCH = struct.Struct("<8I")
_TABLE = struct.Struct("<4I")
_SCAN = struct.Struct("<4d2I")
_ALIGNMENT = 8

_LEVEL = 1
"""How hard to compress. Cells are mostly runs of equal ones: with that in view they become as small
as at level 4 without, in little more than half the time."""


class MessageType(IntEnum):
    """What a message from the server is about."""

    HELLO = 1
    SUBMAP = 2
    SUBMAP_PATCH = 3
    SUBMAP_POSES = 4
    NODES = 5
    NODE_TIMES = 6
    CONSTRAINTS = 7
    SCAN = 8
    READINGS = 9
    PLAYBACK = 10
    LATEST_CLOSURE = 11
    COMPLETE = 12
    CLOSURE = 13
    NODE_SCAN = 14
    PICTURE = 15
    PROBLEM = 16
    PONG = 17
    SUBMAP_PREVIEW = 18
    ANSWER = 19
    QUALITY = 20
    FACTS = 21
    CLOSURES = 22
    BEFORE = 23
    SESSIONS = 24
    EDITS = 25
    EDITED = 26
    PATH = 27
    STATES = 28
    LOCALISATION = 29
    GIVEN = 30


_TABLE_DTYPES = {
    MessageType.SUBMAP_POSES: "<f8",
    MessageType.NODES: "<f8",
    MessageType.NODE_TIMES: "<f8",
    MessageType.PATH: "<f8",
}


REJECTED = 3
"""Kind of a loop closure that was found and is not in the finished graph; the other kinds of a
CONSTRAINTS message are those of :class:`cartoloop.global_slam.pose_graph.ConstraintKind`."""


class Message(NamedTuple):
    """One message out of a WebSocket message: its type, a number or :class:`MessageType`."""

    type: int
    payload: bytes


class Texture(NamedTuple):
    """What a page needs to draw a submap.

    Attributes
    ----------
    cells : uint8, shape (rows, cols): 0 unknown, otherwise the index into HELLO's ``log_odds``.
    origin_x, origin_y : centre of ``cells[0, 0]`` [m, submap frame].
    resolution : edge of a cell [m].
    """

    cells: NDArray[np.uint8]
    origin_x: float
    origin_y: float
    resolution: float


class ConstraintRows(NamedTuple):
    """Constraints as a structure of arrays, all of the same length n.

    Attributes
    ----------
    index_a, index_b : int, ends; see ``kind`` in ``docs/viewer-protocol.md``.
    relative_poses : float (n, 3), tf_a_b as measured [m, m, rad].
    kinds : int, :class:`cartoloop.global_slam.pose_graph.ConstraintKind`, or :data:`REJECTED`.
    closures : int, row of the record of closures, -1 for other constraints; not sent.
    """

    index_a: NDArray[np.integer]
    index_b: NDArray[np.integer]
    relative_poses: NDArray[np.floating]
    kinds: NDArray[np.integer]
    closures: NDArray[np.integer]


def message(kind: MessageType, payload: bytes) -> bytes:
    """Return one message, with header and padding."""
    return b"".join(
        (_HEADER.pack(len(payload), kind, 0), payload, bytes(-len(payload) % _ALIGNMENT))
    )


def json_message(kind: MessageType, content: Mapping[str, Any]) -> bytes:
    """Return a message of JSON; its numbers must be finite."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return message(kind, text.encode("utf-8"))


def answer_message(request: int, answer: bytes) -> bytes:
    """Return a message that is no JSON, together with the `id` of the request that it answers."""
    return json_message(MessageType.ANSWER, {"id": request}) + answer


def submap_message(submap: int, version: int, texture: Texture, *, finished: bool) -> bytes:
    """Return a whole submap."""
    rows, cols = texture.cells.shape
    flags = FINISHED if finished else 0
    head = _SUBMAP.pack(
        submap,
        version,
        flags,
        rows,
        cols,
        0,
        texture.origin_x,
        texture.origin_y,
        texture.resolution,
    )
    return message(MessageType.SUBMAP, head + _packed(texture.cells))


def preview_message(submap: int, texture: Texture) -> bytes:
    """Return a finished submap as a small picture, see :func:`cartoloop.viewer.previews.shrink`."""
    rows, cols = texture.cells.shape
    head = _PREVIEW.pack(
        submap, 0, rows, cols, texture.origin_x, texture.origin_y, texture.resolution
    )
    return message(MessageType.SUBMAP_PREVIEW, head + _packed(texture.cells))


def patch_message(
    submap: int,
    base_version: int,
    version: int,
    first: tuple[int, int],
    cells: NDArray[np.uint8],
) -> bytes:
    """Return the rectangle of a submap that has changed since `base_version`.

    Parameters
    ----------
    first : row and column of ``cells[0, 0]`` in the submap.
    cells : uint8, shape (rows, cols), what stands there now.
    """
    head = _PATCH.pack(submap, base_version, version, *first, *cells.shape, 0)
    return message(MessageType.SUBMAP_PATCH, head + _packed(cells))


def table_message(
    kind: MessageType, revision: int, first: int, values: NDArray[np.floating]
) -> bytes:
    """Return the rows of a table from `first` on: SUBMAP_POSES, NODES, NODE_TIMES or PATH.

    Parameters
    ----------
    revision : rises when older rows change.
    values : all rows: poses, shape (n, 3), stamps [s], shape (n,), or points of a path, shape
        (n, 3).
    """
    head = _TABLE.pack(first, len(values) - first, len(values), revision)
    return message(kind, head + _bytes(values[first:], _TABLE_DTYPES[kind]))


def constraints_message(revision: int, first: int, total: int, rows: ConstraintRows) -> bytes:
    """Return the constraints from `first` on, of `total` that there are."""
    columns = (
        _TABLE.pack(first, len(rows.kinds), total, revision),
        _bytes(rows.index_a, "<u4"),
        _bytes(rows.index_b, "<u4"),
        _bytes(rows.relative_poses, "<f4"),
        _bytes(rows.kinds, "u1"),
    )
    return message(MessageType.CONSTRAINTS, b"".join(columns))


def scan_message(
    number: int,
    time: float,
    tf_map_tracking: tuple[float, float, float],
    points: NDArray[np.floating],
    kind: MessageType = MessageType.SCAN,
) -> bytes:
    """Return a scan: where the robot was, and what it saw.

    Parameters
    ----------
    number : of the scan, or of the node where the kind is NODE_SCAN.
    time : stamp [s].
    tf_map_tracking : where the robot was.
    points : shape (n, 2) [m], tracking frame.
    """
    head = _SCAN.pack(time, *tf_map_tracking, number, len(points))
    return message(kind, head + _bytes(points, "<f4"))


def before_message(
    tf_map_submaps: NDArray[np.floating], tf_map_nodes: NDArray[np.floating]
) -> bytes:
    """Return the poses of all submaps and nodes before loop closure, shapes (m, 3) and (n, 3)."""
    head = struct.pack("<2I", len(tf_map_submaps), len(tf_map_nodes))
    poses = _bytes(tf_map_submaps, "<f8"), _bytes(tf_map_nodes, "<f8")
    return message(MessageType.BEFORE, b"".join((head, *poses)))


def messages(data: bytes) -> Iterator[Message]:
    """Yield the messages that one WebSocket message holds: what the page does, in Python.

    Raises
    ------
    ValueError
        The data ends within a message.
    """
    start = 0
    while start < len(data):
        if len(data) - start < _HEADER.size:
            raise ValueError("the data ends within the header of a message")
        length, kind, _ = _HEADER.unpack_from(data, start)
        start += _HEADER.size
        if start + length > len(data):
            raise ValueError("the data ends within a message")
        yield Message(kind, data[start : start + length])
        start += length + -length % _ALIGNMENT


def _packed(cells: NDArray[np.uint8]) -> bytes:
    packing = zlib.compressobj(_LEVEL, strategy=zlib.Z_RLE)
    return packing.compress(np.ascontiguousarray(cells).data) + packing.flush()


def _bytes(values: NDArray[Any], dtype: str) -> bytes:
    return np.ascontiguousarray(values, dtype=dtype).tobytes()
