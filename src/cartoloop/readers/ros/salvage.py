# SPDX-License-Identifier: Apache-2.0
"""Recordings whose recorder died or whose end is lost, read from the front as far as they go.

The library needs the index, which recorders write last. Here the records are followed one by one.
Also MCAP files that other programs than ROS 2 wrote.
"""

from __future__ import annotations

import bz2
import sqlite3
import struct
from collections.abc import Callable, Collection, Iterator
from contextlib import closing, suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from cartoloop.errors import InputError
from cartoloop.readers.ros.container import Channel, one_line
from cartoloop.readers.ros.inventory import Finding
from cartoloop.readers.ros.wire import NANO

_U32 = struct.Struct("<I")
_U64 = struct.Struct("<Q")
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7  # records of a ROS 1 bag
_MCAP_SCHEMA, _MCAP_CHANNEL, _MCAP_MESSAGE, _MCAP_CHUNK = 3, 4, 5, 6
_MCAP_ENDS = (0x0F, 0x02)  # the data are over: what follows is the summary
_LARGEST_RECORD = 1 << 31

Record = tuple[int, int, bytes]


class _Cut(Exception):  # noqa: N818 - not a fault of the program
    """The file ends, or makes no sense any more."""


def _exactly(file: BinaryIO, size: int) -> bytes:
    if size > _LARGEST_RECORD:
        raise _Cut("a record has an impossible length")
    data = file.read(size)
    if len(data) < size:
        raise _Cut("the file is cut off")
    return data


class _Scanned:
    """What the readers of this module share: one pass that finds the channels and counts."""

    def __init__(self, path: Path, kind: str) -> None:
        self.kind = kind
        self.path = path
        self.damage = ""
        self.notes: list[Finding] = []
        self._found: dict[int, Channel] = {}
        counts: dict[int, int] = {}
        for key, _, _ in self._records(None):
            counts[key] = counts.get(key, 0) + 1
        self._found = {k: c._replace(num_messages=counts.get(k, 0)) for k, c in self._found.items()}
        self.channels = list(self._found.values())

    def messages(self, keys: Collection[int]) -> Iterator[Record]:
        """Yield key, time of recording [ns] and bytes, in the order of recording. Never raises."""
        yield from self._records(frozenset(keys))

    def _records(self, keys: frozenset[int] | None) -> Iterator[Record]:
        """Yield the messages; without `keys` all, noting channels, and without their bytes."""
        raise NotImplementedError


class Bag1Salvage(_Scanned):
    """A ROS 1 bag from front to back; needs no index."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "ROS 1 bag")

    def _records(self, keys: frozenset[int] | None) -> Iterator[Record]:
        with self.path.open("rb") as file:
            if not file.readline().startswith(b"#ROSBAG V2.0"):
                raise InputError(
                    f"{self.path}: is a bag of an old version; convert it: rosbag migrate"
                )
            try:
                while True:
                    header, size = self._record_head(file)
                    if header.get(b"op") != bytes([_CHUNK]):
                        data = _exactly(file, size)
                        yield from self._record(header, data, keys)
                        continue
                    packed = file.read(min(size, _LARGEST_RECORD))
                    plain = self._unpacked(header.get(b"compression", b""), packed)
                    yield from self._chunk(plain, keys)
                    if len(packed) < size:
                        raise _Cut("the file is cut off")
            except EOFError:
                return
            except _Cut as cut:
                self.damage = str(cut)

    def _record_head(self, file: BinaryIO) -> tuple[dict[bytes, bytes], int]:
        """Return the fields of a record's header, and how long its data are."""
        first = file.read(4)
        if not first:
            raise EOFError
        if len(first) < 4:
            raise _Cut("the file is cut off")
        fields = _exactly(file, _U32.unpack(first)[0])
        header, place = {}, 0
        while place + 4 <= len(fields):
            size = _U32.unpack_from(fields, place)[0]
            name, separator, value = fields[place + 4 : place + 4 + size].partition(b"=")
            if not separator:
                raise _Cut("a record makes no sense")
            header[name] = value
            place += 4 + size
        return header, _U32.unpack(_exactly(file, 4))[0]

    def _chunk(self, plain: bytes, keys: frozenset[int] | None) -> Iterator[Record]:
        file = BytesIO(plain)
        try:
            while True:
                header, size = self._record_head(file)
                yield from self._record(header, _exactly(file, size), keys)
        except EOFError:
            return
        except _Cut:
            self.damage = "a chunk is damaged"

    def _unpacked(self, compression: bytes, packed: bytes) -> bytes:
        """Return as much of a chunk as can be unpacked."""
        if compression == b"none":
            return packed
        if compression == b"bz2":
            unpack: Callable[[bytes], bytes] = bz2.BZ2Decompressor().decompress
        elif compression == b"lz4":
            from lz4.frame import LZ4FrameDecompressor

            unpack = LZ4FrameDecompressor().decompress
        else:
            raise _Cut(f"a chunk has an unknown compression {compression!r}")
        return self._by_pieces(unpack, packed)

    def _by_pieces(self, unpack: Callable[[bytes], bytes], packed: bytes) -> bytes:
        plain = []
        for start in range(0, len(packed), 1024):
            try:
                plain.append(unpack(packed[start : start + 1024]))
            except (OSError, ValueError, EOFError, RuntimeError):
                self.damage = "a chunk is damaged"
                break
        return b"".join(plain)

    def _record(
        self, header: dict[bytes, bytes], data: bytes, keys: frozenset[int] | None
    ) -> Iterator[Record]:
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
            raise _Cut("a record makes no sense") from None

    def _note_connection(self, header: dict[bytes, bytes], data: bytes) -> None:
        from rosbags.typesys.msg import normalize_msgtype

        fields = BytesIO(_U32.pack(len(data)) + data + _U32.pack(0))
        told, _ = self._record_head(fields)
        key = _U32.unpack(header[b"conn"])[0]
        topic = header[b"topic"].decode("utf-8", "replace")
        msgtype = told[b"type"].decode("utf-8", "replace")
        self._found[key] = Channel(key, topic, normalize_msgtype(msgtype), True, 0)


class McapSalvage(_Scanned):
    """An MCAP file from front to back; needs no index, and reads ROS 1 messages as well."""

    def __init__(self, path: Path) -> None:
        self._schemas: dict[int, str] = {}
        super().__init__(path, "MCAP file")

    def _records(self, keys: frozenset[int] | None) -> Iterator[Record]:
        with self.path.open("rb") as file:
            file.seek(8)
            try:
                yield from self._all(file, keys)
            except EOFError:
                self.damage = self.damage or "the file is cut off"
            except _Cut as cut:
                self.damage = str(cut)

    def _all(self, file: BinaryIO, keys: frozenset[int] | None) -> Iterator[Record]:
        while True:
            code = file.read(1)
            if not code:
                raise EOFError
            if code[0] in _MCAP_ENDS:
                return
            size = _U64.unpack(_exactly(file, 8))[0]
            data = file.read(min(size, _LARGEST_RECORD))
            whole = len(data) == size
            if code[0] == _MCAP_CHUNK:
                plain = self._unpacked(data)
                # Its end is no damage; a broken record costs the rest of this chunk alone.
                with suppress(EOFError):
                    yield from self._chunk(plain, keys)
            elif whole:
                yield from self._record(code[0], data, keys)
            if not whole:
                raise _Cut("the file is cut off")

    def _chunk(self, plain: bytes, keys: frozenset[int] | None) -> Iterator[Record]:
        try:
            yield from self._all(BytesIO(plain), keys)
        except _Cut:
            self.damage = "a chunk is damaged"

    def _unpacked(self, data: bytes) -> bytes:
        """Return as much of a chunk as can be unpacked."""
        try:
            name_size = _U32.unpack_from(data, 28)[0]
            compression = data[32 : 32 + name_size]
            packed = data[40 + name_size :]
        except struct.error:
            return b""
        if compression == b"":
            return packed
        unpack: Callable[[bytes], bytes]
        if compression == b"lz4":
            from lz4.frame import LZ4FrameDecompressor

            unpack = LZ4FrameDecompressor().decompress
        elif compression == b"zstd":
            from cartoloop.readers.ros.zstd import zstd

            unpack = zstd.ZstdDecompressor().decompress
        else:
            raise _Cut(f"a chunk has an unknown compression {compression!r}")
        plain = []
        for start in range(0, len(packed), 1024):
            try:
                plain.append(unpack(packed[start : start + 1024]))
            except Exception:  # noqa: BLE001 - each compression raises its own
                self.damage = "a chunk is damaged"
                break
        return b"".join(plain)

    def _record(self, code: int, data: bytes, keys: frozenset[int] | None) -> Iterator[Record]:
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
            raise _Cut("a record makes no sense") from None

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
    return data[place + 4 : end].decode("utf-8", "replace"), end


class SqliteSalvage(_Scanned):
    """A damaged database of ROS 2, row by row until it breaks off."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "ROS 2 database")

    def _records(self, keys: frozenset[int] | None) -> Iterator[Record]:
        try:
            with closing(self._connect()) as connection:
                if keys is None:
                    rows = connection.execute("SELECT id, name, type FROM topics")
                    for key, topic, msgtype in rows:
                        self._found[int(key)] = Channel(
                            int(key), str(topic), str(msgtype), False, 0
                        )
                for key, time, data in connection.execute(
                    "SELECT topic_id, timestamp, data FROM messages"
                ):
                    if key in self._found and (keys is None or key in keys):
                        yield int(key), int(time), b"" if keys is None else bytes(data)
        except (sqlite3.Error, TypeError, ValueError) as error:
            self.damage = one_line(error)

    def _connect(self) -> sqlite3.Connection:
        from urllib.parse import quote

        # Immutable: a recording is only read, and may lie where nothing can be written.
        name = f"file:{quote(str(self.path))}?mode=ro&immutable=1"
        connection = sqlite3.connect(name, uri=True)
        # Otherwise a file that lacks its last pages is refused as a whole.
        connection.execute("PRAGMA writable_schema=ON")
        return connection
