# SPDX-License-Identifier: Apache-2.0
"""ROS 1 bags whose recorder died or whose end is lost, read from the front."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from cartoloop.errors import InputError
from cartoloop.plain_text import one_line
from cartoloop.readers.ros.container import Channel
from cartoloop.readers.ros.salvage import (
    LARGEST_RECORD,
    CutError,
    RecordedMessage,
    SalvageContainer,
    at_most,
    exactly,
)
from cartoloop.readers.ros.wire import NANO

_U32 = struct.Struct("<I")
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7


class BagSalvage(SalvageContainer):
    """A ROS 1 bag from front to back; needs no index."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "ROS 1 bag")

    def _records(self, keys: frozenset[int] | None) -> Iterator[RecordedMessage]:
        with self.path.open("rb") as file:
            if not file.readline().startswith(b"#ROSBAG V2.0"):
                raise InputError(
                    f"{self.path}: is a bag of an old version; convert it: rosbag migrate"
                )
            try:
                while True:
                    header, size = self._record_head(file)
                    if header.get(b"op") != bytes([_CHUNK]):
                        data = exactly(file, size)
                        yield from self._record(header, data, keys)
                        continue
                    packed = at_most(file, min(size, LARGEST_RECORD))
                    compression = header.get(b"compression", b"").decode("ascii", "replace")
                    plain = self._unpack(compression, packed)
                    yield from self._chunk(plain, keys)
                    if len(packed) < size:
                        raise CutError("the file is cut off")
            except EOFError:
                return
            except CutError as cut:
                self.damage = str(cut)

    def _record_head(self, file: BinaryIO) -> tuple[dict[bytes, bytes], int]:
        """Return the fields of a record's header, and the length of its data [bytes]."""
        first = file.read(4)
        if not first:
            raise EOFError
        if len(first) < 4:
            raise CutError("the file is cut off")
        fields = exactly(file, _U32.unpack(first)[0])
        header, place = {}, 0
        while place + 4 <= len(fields):
            size = _U32.unpack_from(fields, place)[0]
            name, separator, value = fields[place + 4 : place + 4 + size].partition(b"=")
            if not separator:
                raise CutError("a record is not valid")
            header[name] = value
            place += 4 + size
        return header, _U32.unpack(exactly(file, 4))[0]

    def _chunk(self, plain: bytes, keys: frozenset[int] | None) -> Iterator[RecordedMessage]:
        file = BytesIO(plain)
        try:
            while True:
                header, size = self._record_head(file)
                yield from self._record(header, exactly(file, size), keys)
        except EOFError:
            return
        except CutError:
            self.damage = "a chunk is damaged"

    def _record(
        self, header: dict[bytes, bytes], data: bytes, keys: frozenset[int] | None
    ) -> Iterator[RecordedMessage]:
        try:
            kind = header[b"op"][0]
            if kind == _CONNECTION and keys is None:
                self._note_connection(header, data)
            elif kind == _MESSAGE:
                key = _U32.unpack(header[b"conn"])[0]
                if key in self._found and (keys is None or key in keys):
                    seconds, nanos = struct.unpack("<II", header[b"time"])
                    yield key, seconds * NANO + nanos, b"" if keys is None else data
        except (KeyError, IndexError, struct.error):
            raise CutError("a record is not valid") from None

    def _note_connection(self, header: dict[bytes, bytes], data: bytes) -> None:
        from rosbags.typesys.msg import normalize_msgtype

        fields = BytesIO(_U32.pack(len(data)) + data + _U32.pack(0))
        fields_of_type, _ = self._record_head(fields)
        key = _U32.unpack(header[b"conn"])[0]
        topic = one_line(header[b"topic"].decode("utf-8", "replace"))
        msgtype = one_line(fields_of_type[b"type"].decode("utf-8", "replace"))
        self._found[key] = Channel(key, topic, normalize_msgtype(msgtype), True, 0)
