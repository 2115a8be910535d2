# SPDX-License-Identifier: Apache-2.0
"""The lines of a text recording, plain or gzip, whole or cut off."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path

from cartoloop.errors import InputError
from cartoloop.readers.log import short_name

_CHUNK_BYTES = 1 << 16
"""Bytes read at a time."""

_KEEP_BYTES = 24 << 20
"""Contents up to this size are kept in memory: as much as the arrays of a small map."""

_GZIP_MAGIC = b"\x1f\x8b"

# Files that are given by mistake, by their first bytes, and what to do about it.
_FOREIGN = (
    (b"\x89PNG", "a PNG picture, not a recording; give the log it was made from"),
    (b"\xff\xd8\xff", "a JPEG picture, not a recording; give the log it was made from"),
    (b"%PDF", "a PDF document, not a recording; give the log itself"),
    (b"PK\x03\x04", "a zip archive; unpack it and give the log inside"),
    (b"BZh", "bzip2-compressed; unpack it (bunzip2) and give the log inside"),
    (b"\xfd7zXZ", "xz-compressed; unpack it (unxz) and give the log inside"),
    (b"\x28\xb5\x2f\xfd", "zstd-compressed; unpack it (unzstd) and give the log inside"),
)


class TextFile:
    """The lines of one file, to be read any number of times.

    Contents of up to 24 MB stay in memory, so that a second pass costs no decompression; larger
    files are read again.

    Attributes
    ----------
    path : the file.
    name : its last path component, as messages show it.
    damage : what was wrong with the compressed stream, or "" (known after the first pass).
    ends_mid_line : whether the last line lacks its newline (known after the first pass).

    Raises
    ------
    InputError
        If the file cannot be read, is empty or is plainly no text.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.name = short_name(self.path)
        self.damage = ""
        self.ends_mid_line = False
        self._lines: list[bytes] | None = None
        if self.path.is_dir():
            raise InputError(f"{self.path}: is a folder; give the recording inside it")
        self._load()

    def lines(self) -> Iterator[bytes]:
        """Yield the lines in file order, without their newlines."""
        if self._lines is not None:
            return iter(self._lines)
        return self._stream_lines()

    def _check(self, head: bytes) -> None:
        """Raise `InputError` if the first bytes are those of something else than a text log."""
        for magic, what in _FOREIGN:
            if head.startswith(magic):
                raise InputError(f"{self.path}: is {what}")
        if head[:512].lstrip().lower().startswith((b"<!doctype", b"<html", b"<?xml")):
            raise InputError(
                f"{self.path}: is a web page, not a recording; "
                "the download went wrong, fetch the file itself"
            )
        if b"\x00" in head[:65536]:
            raise InputError(
                f"{self.path}: is binary, and no ROS bag; "
                "give a ROS bag, or a text log, plain or gzip"
            )

    def _load(self) -> None:
        chunks: list[bytes] = []
        size = 0
        for chunk in self._chunks():
            if not chunks:
                self._check(chunk)
            chunks.append(chunk)
            size += len(chunk)
            if size > _KEEP_BYTES:
                return
        if not chunks and self.damage:
            raise InputError(f"{self.path}: {self.damage}, nothing can be read; download it again")
        if not chunks:
            raise InputError(f"{self.path}: is empty; record or download it again")
        lines = b"".join(chunks).split(b"\n")
        self.ends_mid_line = bool(lines[-1])
        self._lines = lines if lines[-1] else lines[:-1]

    def _stream_lines(self) -> Iterator[bytes]:
        rest = b""
        for chunk in self._chunks():
            lines = (rest + chunk).split(b"\n")
            rest = lines.pop()
            yield from lines
        self.ends_mid_line = bool(rest)
        if rest:
            yield rest

    def _chunks(self) -> Iterator[bytes]:
        """Yield the decompressed contents up to any damage, which is noted in `damage`."""
        try:
            with self.path.open("rb") as file:
                first = file.read(_CHUNK_BYTES)
                raw = _continued(first, iter(lambda: file.read(_CHUNK_BYTES), b""))
                if first.startswith(_GZIP_MAGIC):
                    yield from self._unzipped(raw)
                else:
                    yield from raw
        except FileNotFoundError:
            raise InputError(f"{self.path}: does not exist; check the path") from None
        except OSError as error:
            reason = error.strerror or str(error)
            raise InputError(f"{self.path}: cannot be read ({reason}); check the file") from None

    def _unzipped(self, raw: Iterator[bytes]) -> Iterator[bytes]:
        # Not the gzip module: it discards what it had decompressed when the stream is cut off.
        stream = zlib.decompressobj(wbits=31)
        for compressed in raw:
            data = compressed
            while data:
                if stream.eof:
                    if not data.startswith(_GZIP_MAGIC):
                        return  # padding after the last member
                    stream = zlib.decompressobj(wbits=31)
                before = stream.copy()
                try:
                    plain = stream.decompress(data)
                except zlib.error as error:
                    self.damage = f"gzip stream is damaged ({error})"
                    yield from _until_damage(before, data)
                    return
                if plain:
                    yield plain
                data = stream.unused_data
        if not stream.eof:
            self.damage = "gzip stream is cut off"


def _continued(first: bytes, rest: Iterator[bytes]) -> Iterator[bytes]:
    """Yield `first`, unless it is empty, then `rest`."""
    if first:
        yield first
        yield from rest


def _until_damage(stream: zlib._Decompress, data: bytes) -> Iterator[bytes]:
    """Yield the decompressed part of `data` before the byte at which decompression fails."""
    for i in range(len(data)):
        try:
            plain = stream.decompress(data[i : i + 1])
        except zlib.error:
            return
        if plain:
            yield plain
