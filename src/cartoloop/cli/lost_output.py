# SPDX-License-Identifier: Apache-2.0
"""Standard output and error of this program: what cannot be written is forgotten.

The reader of a pipe leaves, a disk is full, a terminal is closed: a map that is being made, or a
robot that drives, matters more than what is said about it. Control characters in the output are
made visible.
"""

from __future__ import annotations

import errno
import io
import os
import select
import sys
from typing import TYPE_CHECKING, TextIO, cast

from cartoloop.plain_text import plain_lines

if TYPE_CHECKING:
    from typing_extensions import Buffer  # of collections.abc from Python 3.12 on


class _Forgetful(io.FileIO):
    """A file that notes the loss of output and goes on.

    Attributes
    ----------
    failure : the first reason why something could not be written, or None.
    """

    failure: OSError | None = None

    def write(self, data: Buffer, /) -> int:
        """Write, or forget the data."""
        try:
            return super().write(data)
        except OSError as error:
            self.failure = self.failure or error
            return memoryview(data).nbytes


class _PlainOutput(io.TextIOWrapper):
    """A stream that makes control characters visible: names in the output are not the user's."""

    def write(self, text: str) -> int:
        """Write lines of text."""
        super().write(plain_lines(text))
        return len(text)


class _StyledOutput:
    """The same stream for the colours and the moving bars of this program."""

    def __init__(self, stream: io.TextIOWrapper) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write text with its control characters."""
        return io.TextIOWrapper.write(self._stream, text)

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)


def styled(stream: TextIO) -> TextIO:
    """Return a stream that passes on control characters; for text whose names are plain already."""
    return cast(TextIO, _StyledOutput(stream)) if isinstance(stream, _PlainOutput) else stream


def forget_lost_output() -> None:
    """Let standard output and error of this process forget what cannot be written.

    Where one is closed, another file must not get its number: that would receive the messages.
    """
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    if sys.stdin is None:
        sys.stdin = open(0, closefd=False, encoding="utf-8")  # noqa: SIM115
    sys.stdout = _forgetful(sys.stdout, 1)
    sys.stderr = _forgetful(sys.stderr, 2)


def loss_of_output() -> OSError | None:
    """Return why a part of standard output was lost; None if nothing was, or its reader left."""
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    failure = raw.failure if isinstance(raw, _Forgetful) else None
    return None if failure is None or failure.errno == errno.EPIPE else failure


def would_wait(stream: TextIO) -> bool:
    """Return whether writing a line would wait: a pipe is full, or a terminal was stopped."""
    try:
        return not select.select([], [stream], [], 0.0)[1]
    except (OSError, ValueError):  # Windows, or no file behind it
        return False


def _forgetful(stream: TextIO | None, descriptor: int) -> TextIO:
    """Return a stream to the same file, with the same encoding and buffering."""
    if stream is not None and not isinstance(stream, io.TextIOWrapper):
        return stream  # of a program that runs this one
    raw = _Forgetful(descriptor, "w", closefd=False)
    if stream is None:
        return _PlainOutput(io.BufferedWriter(raw), encoding="utf-8", line_buffering=True)
    return _PlainOutput(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        # Any path can be printed on any terminal.
        errors="backslashreplace" if stream.errors == "strict" else stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
