# SPDX-License-Identifier: Apache-2.0
"""Reading what the user names: never more than a budget, and never waiting for ever.

A path may be a device without end, a pipe that nobody writes to, or a file of the system that
blocks. A pipe that someone writes to is as good as a file.
"""

from __future__ import annotations

import io
import os
import select
import stat
import time
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import BinaryIO

from cartoloop.errors import CartoloopError, InputError

FIRST_BYTE_S = 10.0
"""Time for someone to write to a pipe or a device [s]."""

BLOCKED_S = 2.0
"""Time for a device or a file of the system to give something [s]: nobody has to start it."""

SILENT_S = 60.0
"""Longest pause of a writer [s]."""

_CHUNK = 1 << 16


class _PatientFile(io.RawIOBase):
    """A pipe, a device or a file of the system, opened without blocking; each read waits a while.

    Raises
    ------
    TimeoutError
        Nothing comes.
    """

    def __init__(self, descriptor: int, is_pipe: bool) -> None:
        self._descriptor = descriptor
        self._is_pipe = is_pipe
        self._has_begun = False
        self._poll = select.poll()
        self._poll.register(descriptor, select.POLLIN)

    def readable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        deadline = time.monotonic() + (FIRST_BYTE_S if self._is_pipe else BLOCKED_S)
        has_writer = False
        while True:
            try:
                data = os.read(self._descriptor, len(buffer))
            except BlockingIOError:
                if self._is_pipe and not has_writer:
                    has_writer = True
                    deadline += SILENT_S - FIRST_BYTE_S
            else:
                # A pipe that nobody has opened for writing yet seems to end.
                if data or self._has_begun or not self._is_pipe or has_writer:
                    self._has_begun = True
                    buffer[: len(data)] = data
                    return len(data)
            left = deadline - time.monotonic()
            if left <= 0.0:
                raise TimeoutError(None, "nothing comes from it")
            events = self._poll.poll(1e3 * min(left, 1.0))
            if events and not events[0][1] & select.POLLIN:
                return 0  # who wrote to the pipe is gone

    def close(self) -> None:
        if not self.closed:
            os.close(self._descriptor)
        super().close()


def open_input(path: str | PathLike[str]) -> BinaryIO:
    """Return a file opened for reading; what is not plain data on a disk is waited for briefly.

    Raises
    ------
    OSError
        It cannot be opened. Reading raises `TimeoutError` if nothing comes.
    """
    if not hasattr(os, "O_NONBLOCK"):
        return Path(path).open("rb")
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    about = os.fstat(descriptor)
    # Files of the system have no size.
    if stat.S_ISREG(about.st_mode) and about.st_size > 0:
        return os.fdopen(descriptor, "rb")
    if stat.S_ISDIR(about.st_mode):
        os.close(descriptor)
        raise IsADirectoryError(21, "Is a directory")
    return io.BufferedReader(_PatientFile(descriptor, stat.S_ISFIFO(about.st_mode)))


def read_input(
    path: str | PathLike[str],
    max_bytes: int,
    expected: str,
    error: Callable[[str], CartoloopError] = InputError,
) -> bytes:
    """Return the content of a file.

    Parameters
    ----------
    path : the file.
    max_bytes : budget; there is no such file of this kind that is longer.
    expected : what should be in it, for the message.
    error : kind of error to raise.

    Raises
    ------
    CartoloopError
        It cannot be read, nothing comes, or it is longer than the budget.
    """
    content = bytearray()
    try:
        with open_input(path) as file:
            while chunk := file.read(_CHUNK):
                content += chunk
                if len(content) > max_bytes:
                    raise error(f"{path}: is longer than {max_bytes >> 20} MB; expected {expected}")
    except OSError as failure:
        reason = failure.strerror or str(failure)
        raise error(f"{path}: cannot be read: {reason}; expected {expected}") from failure
    return bytes(content)


def read_text_input(
    path: str | PathLike[str],
    max_bytes: int,
    expected: str,
    error: Callable[[str], CartoloopError] = InputError,
) -> str:
    """Return the text in a file, without a byte order mark before it; see `read_input`.

    Raises
    ------
    CartoloopError
        As `read_input`, or it is no text.
    """
    try:
        text = read_input(path, max_bytes, expected, error).decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        raise error(f"{path}: is no text; expected {expected}") from fault
    return text.replace("\r\n", "\n").replace("\r", "\n")
