# SPDX-License-Identifier: Apache-2.0
"""The lines of a text recording, plain or gzip, whole or cut off."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path

from cartoloop.errors import InputError
from cartoloop.input_file import open_input
from cartoloop.readers.log import short_name

_CHUNK_BYTES = 1 << 16
"""Bytes read at a time."""

_PLAIN_BYTES = 1 << 20
"""Bytes unpacked at a time."""

_MIN_LINE_BYTES = 8
"""A piece of that size whose lines are shorter on average holds no recording [bytes]."""

_KEEP_BYTES, _KEEP_LINES = 24 << 20, 1_000_000
"""Contents up to this size are kept in memory: as much as the arrays of a small map."""

MAX_LINE_BYTES = 4 << 20
"""Longer lines are no scans [bytes]: 100,000 ranges of 10 digits take 1 MB."""

OVERLONG = bytes(bytearray(b"a line that is too long"))
"""Stands for a line that is too long; compare with ``is``."""

_UNPACKED_BYTES, _UNPACKED_RATIO = 16 << 20, 100
"""A gzip file may unpack to this number of bytes and this multiple of its size: logs unpack
to ten times their size, of zeros to a thousand times."""

_GZIP_MAGIC = b"\x1f\x8b"

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""With which some editors begin UTF-8."""

# Files that are given by mistake, by their first bytes, and what to do about it.
_FOREIGN = (
    (b"\xff\xfe", "text in UTF-16; save it as UTF-8 or ASCII"),
    (b"\xfe\xff", "text in UTF-16; save it as UTF-8 or ASCII"),
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
        """Yield the lines in file order, without their newlines; `OVERLONG` for one too long."""
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
        size = num_lines = 0
        for chunk in self._chunks():
            if not chunks:
                self._check(chunk)
            chunks.append(chunk)
            size += len(chunk)
            num_lines += chunk.count(b"\n")
            if size > _KEEP_BYTES or num_lines > _KEEP_LINES:
                return
        if not chunks and self.damage:
            raise InputError(f"{self.path}: {self.damage}, nothing can be read; download it again")
        if not chunks:
            raise InputError(f"{self.path}: is empty; record or download it again")
        lines = b"".join(chunks).split(b"\n")
        self.ends_mid_line = bool(lines[-1])
        lines = lines if lines[-1] else lines[:-1]
        self._lines = [OVERLONG if len(line) > MAX_LINE_BYTES else line for line in lines]

    def _stream_lines(self) -> Iterator[bytes]:
        # The parts of a line are joined once: a line may span any number of chunks.
        parts: list[bytes] = []
        size = 0
        for chunk in self._chunks():
            first, *lines = chunk.split(b"\n")
            size += len(first)
            if size <= MAX_LINE_BYTES:
                parts.append(first)
            else:
                parts.clear()
            if not lines:
                continue
            yield b"".join(parts) if size <= MAX_LINE_BYTES else OVERLONG
            *lines, last = lines
            for line in lines:
                yield line if len(line) <= MAX_LINE_BYTES else OVERLONG
            parts, size = [last], len(last)
        self.ends_mid_line = size > 0
        if size:
            yield b"".join(parts) if size <= MAX_LINE_BYTES else OVERLONG

    def _chunks(self) -> Iterator[bytes]:
        """Yield the decompressed contents up to any damage, which is noted in `damage`."""
        try:
            with open_input(self.path) as file:
                first = file.read(_CHUNK_BYTES)
                raw = _continued(first, iter(lambda: file.read(_CHUNK_BYTES), b""))
                text = self._unzipped(raw) if first.startswith(_GZIP_MAGIC) else raw
                begin = next(text, b"")
                yield from _continued(begin.removeprefix(_BYTE_ORDER_MARK), text)
        except FileNotFoundError:
            raise InputError(f"{self.path}: does not exist; check the path") from None
        except OSError as error:
            reason = error.strerror or str(error)
            raise InputError(f"{self.path}: cannot be read ({reason}); check the file") from None

    def _unzipped(self, raw: Iterator[bytes]) -> Iterator[bytes]:
        # Not the gzip module: it discards what it had decompressed when the stream is cut off.
        stream = zlib.decompressobj(wbits=31)
        budget = _UNPACKED_BYTES
        for compressed in raw:
            data = compressed
            budget += _UNPACKED_RATIO * len(data)
            is_pending = False
            while data or is_pending:
                if stream.eof:
                    if not data.startswith(_GZIP_MAGIC):
                        return  # padding after the last member
                    stream = zlib.decompressobj(wbits=31)
                before = stream.copy()
                try:
                    plain = stream.decompress(data, _PLAIN_BYTES)
                except zlib.error as error:
                    self.damage = f"gzip stream is damaged ({error})"
                    yield from _until_damage(before, data)
                    return
                budget -= len(plain)
                if budget < 0 or _is_padding(plain):
                    self.damage = (
                        f"gzip stream unpacks to more than {_UNPACKED_RATIO} times its size"
                        if budget < 0
                        else "gzip stream unpacks to empty lines"
                    )
                    return
                if plain:
                    yield plain
                data = stream.unconsumed_tail or stream.unused_data
                is_pending = len(plain) == _PLAIN_BYTES and not stream.eof
        if not stream.eof:
            self.damage = "gzip stream is cut off"


def _is_padding(plain: bytes) -> bool:
    """Return whether a whole piece of unpacked text is of lines that are too short to be used."""
    return len(plain) == _PLAIN_BYTES and plain.count(b"\n") * _MIN_LINE_BYTES > len(plain)


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
