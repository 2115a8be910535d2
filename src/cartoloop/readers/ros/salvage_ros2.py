# SPDX-License-Identifier: Apache-2.0
"""ROS 2 recordings whose recorder died or whose end is lost, read from the front.

Also MCAP files that other programs than ROS 2 wrote, with ROS 1 messages in them or others.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from cartoloop.foreign_database import open_database
from cartoloop.plain_text import one_line
from cartoloop.readers.ros.container import Channel, message_bytes, reason_of, recorded_time
from cartoloop.readers.ros.salvage import (
    LARGEST_RECORD,
    CutError,
    RecordedMessage,
    SalvageContainer,
    at_most,
    exactly,
)

TABLES = ("schema", "metadata", "message_definitions", "topics", "messages")
"""Of a database of ROS 2, those that are queried."""

_U32 = struct.Struct("<I")
_U64 = struct.Struct("<Q")
_MCAP_SCHEMA, _MCAP_CHANNEL, _MCAP_MESSAGE, _MCAP_CHUNK = 3, 4, 5, 6
_MCAP_ENDS = (0x0F, 0x02)  # end of data: the summary follows


class McapSalvage(SalvageContainer):
    """An MCAP file from front to back; needs no index, and reads ROS 1 messages as well."""

    def __init__(self, path: Path) -> None:
        self._schemas: dict[int, str] = {}
        super().__init__(path, "MCAP file")

    def _records(self, keys: frozenset[int] | None) -> Iterator[RecordedMessage]:
        with self.path.open("rb") as file:
            file.read(8)  # signature
            try:
                yield from self._all(file, keys)
            except EOFError:
                self.damage = self.damage or "the file is cut off"
            except CutError as cut:
                self.damage = str(cut)

    def _all(self, file: BinaryIO, keys: frozenset[int] | None) -> Iterator[RecordedMessage]:
        while True:
            code = file.read(1)
            if not code:
                raise EOFError
            if code[0] in _MCAP_ENDS:
                return
            size = _U64.unpack(exactly(file, 8))[0]
            data = at_most(file, min(size, LARGEST_RECORD))
            whole = len(data) == size
            if code[0] == _MCAP_CHUNK:
                plain = self._unpacked(data)
                # Its end is no damage; a broken record loses only the rest of this chunk.
                with suppress(EOFError):
                    yield from self._chunk(plain, keys)
            elif whole:
                yield from self._record(code[0], data, keys)
            if not whole:
                raise CutError("the file is cut off")

    def _chunk(self, plain: bytes, keys: frozenset[int] | None) -> Iterator[RecordedMessage]:
        try:
            yield from self._all(BytesIO(plain), keys)
        except CutError:
            self.damage = "a chunk is damaged"

    def _unpacked(self, data: bytes) -> bytes:
        """Return the part of a chunk that can be unpacked."""
        try:
            name_size = _U32.unpack_from(data, 28)[0]
        except struct.error:
            return b""
        compression = data[32 : 32 + name_size].decode("ascii", "replace")
        return self._unpack(compression, data[40 + name_size :])

    def _record(
        self, code: int, data: bytes, keys: frozenset[int] | None
    ) -> Iterator[RecordedMessage]:
        try:
            if code == _MCAP_MESSAGE:
                key = struct.unpack_from("<H", data)[0]
                if key in self._found and (keys is None or key in keys):
                    yield key, _U64.unpack_from(data, 6)[0], b"" if keys is None else data[22:]
            elif code == _MCAP_SCHEMA:
                self._schemas[struct.unpack_from("<H", data)[0]] = _text(data, 2)[0]
            elif code == _MCAP_CHANNEL and keys is None:
                self._note_channel(data)
        except (struct.error, IndexError):
            raise CutError("a record is not valid") from None

    def _note_channel(self, data: bytes) -> None:
        from rosbags.typesys.msg import normalize_msgtype

        key, schema = struct.unpack_from("<HH", data)
        topic, place = _text(data, 4)
        encoding, _ = _text(data, place)
        msgtype = self._schemas.get(schema, "")
        if encoding not in ("cdr", "ros1"):
            msgtype = f"{msgtype} ({encoding})"
        elif encoding == "ros1":
            msgtype = normalize_msgtype(msgtype)
        self._found.setdefault(key, Channel(key, topic, msgtype, encoding == "ros1", 0))


def _text(data: bytes, place: int) -> tuple[str, int]:
    size = _U32.unpack_from(data, place)[0]
    end = place + 4 + size
    return one_line(data[place + 4 : end].decode("utf-8", "replace")), end


class DatabaseSalvage(SalvageContainer):
    """A damaged database of ROS 2, row by row until it breaks off."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "ROS 2 database")

    def _records(self, keys: frozenset[int] | None) -> Iterator[RecordedMessage]:
        try:
            with closing(self._connect()) as connection:
                if keys is None:
                    rows = connection.execute("SELECT id, name, type FROM topics")
                    for key, topic, msgtype in rows:
                        if isinstance(key, int):
                            names = one_line(str(topic)), one_line(str(msgtype))
                            self._found[key] = Channel(key, *names, is_ros1=False, num_messages=0)
                for key, time, data in connection.execute(
                    "SELECT topic_id, timestamp, data FROM messages"
                ):
                    if key in self._found and (keys is None or key in keys):
                        plain = b"" if keys is None else message_bytes(data)
                        yield key, recorded_time(time), plain
        except sqlite3.Error as error:
            self.damage = reason_of(error)

    def _connect(self) -> sqlite3.Connection:
        # Otherwise a file that lacks its last pages is refused as a whole.
        return open_database(self.path, TABLES, is_damaged=True)
