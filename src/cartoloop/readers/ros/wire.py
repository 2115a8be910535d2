# SPDX-License-Identifier: Apache-2.0
"""The byte layouts of ROS messages: packed in ROS 1, CDR with padding in ROS 2.

Both begin a message that has a header alike: four bytes (ROS 1: sequence number; CDR: byte order),
seconds, nanoseconds, the length of the frame's name, and from byte 16 on the name.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from cartoloop.plain_text import one_line

_TIME = {order: struct.Struct(f"{order}iII") for order in "<>"}

NANO = 1_000_000_000


class DecodeError(Exception):
    """A message that does not match its type; the text is the reason it is counted under."""


class MessageHeader(NamedTuple):
    """Stamp [ns], name of the frame, end of the header [bytes], and byte order of the message."""

    stamp: int
    frame: bytes
    end: int
    order: str


def byte_order(raw: bytes, is_ros1: bool) -> str:
    """Return ``<`` or ``>``.

    Raises
    ------
    DecodeError
        The message is too short, or in an encoding that ROS 2 does not write.
    """
    if is_ros1:
        return "<"
    if len(raw) < 4 or raw[0] != 0 or raw[1] > 1:
        raise DecodeError("not in CDR encoding")
    return "<" if raw[1] else ">"


def read_header(raw: bytes, is_ros1: bool) -> MessageHeader:
    """Return the header that a message begins with.

    Raises
    ------
    DecodeError
        The message is too short.
    """
    order = byte_order(raw, is_ros1)
    try:
        seconds, nanos, length = _TIME[order].unpack_from(raw, 4)
    except struct.error:
        raise DecodeError("cut off") from None
    end = 16 + length
    if end > len(raw):
        raise DecodeError("cut off")
    frame = raw[16:end] if is_ros1 else raw[16 : end - 1]
    if is_ros1 and seconds < 0:
        seconds += 1 << 32
    return MessageHeader(seconds * NANO + nanos, frame, end, order)


def aligned(offset: int, size: int, is_ros1: bool) -> int:
    """Return the offset of the next number of `size` bytes: CDR aligns from its fourth byte on."""
    return offset if is_ros1 else offset + (4 - offset) % size


def frame_name(raw: bytes) -> str:
    """Return a frame's name without the leading slash of ROS 1, so that names compare equal."""
    return one_line(raw.decode("utf-8", "replace").lstrip("/"))


class Cursor:
    """Reads one value after the other; for messages that are not frequent.

    Every method raises `DecodeError` where the message ends too early.
    """

    def __init__(self, raw: bytes, is_ros1: bool, offset: int | None = None) -> None:
        self._raw = raw
        self._is_ros1 = is_ros1
        self.order = byte_order(raw, is_ros1)
        self.offset = (0 if is_ros1 else 4) if offset is None else offset

    def u32(self) -> int:
        """Return the next unsigned 32-bit number."""
        return int(self.numbers("I", 4, 1)[0])

    def numbers(self, code: str, size: int, count: int) -> tuple[float, ...]:
        """Return the next `count` numbers of the `struct` code and size given."""
        start = aligned(self.offset, size, self._is_ros1)
        try:
            values = struct.unpack_from(f"{self.order}{count}{code}", self._raw, start)
        except struct.error:
            raise DecodeError("cut off") from None
        self.offset = start + size * count
        return values

    def text(self) -> bytes:
        """Return the next string."""
        length = self.u32()
        return self.data(length) if self._is_ros1 else self.data(length)[:-1]

    def data(self, length: int) -> bytes:
        """Return the next `length` bytes."""
        start, self.offset = self.offset, self.offset + length
        if self.offset > len(self._raw):
            raise DecodeError("cut off")
        return self._raw[start : self.offset]

    def header(self) -> MessageHeader:
        """Return a header that stands within the message."""
        if self._is_ros1:
            self.u32()
        seconds, nanos = self.numbers("I", 4, 2)
        frame = self.text()
        return MessageHeader(int(seconds) * NANO + int(nanos), frame, self.offset, self.order)
