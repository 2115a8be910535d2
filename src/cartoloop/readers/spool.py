# SPDX-License-Identifier: Apache-2.0
"""Recordings that come through a pipe, copied into a temporary file: they are read repeatedly.

``-`` is standard input, as are ``/dev/stdin`` and ``/dev/fd/0``.
"""

from __future__ import annotations

import atexit
import io
import os
import select
import shutil
import stat
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from cartoloop.errors import InputError
from cartoloop.input_file import open_input

STANDARD_INPUT = "standard input"
"""Name of a recording that came through it."""

_CHUNK = 1 << 20

_SIGNALS_S = 0.5
"""Signals are handled within this time while nothing comes [s]."""

_STANDARD_INPUTS = (Path("-"), Path("/dev/stdin"), Path("/dev/fd/0"), Path("/proc/self/fd/0"))


def regular_files(paths: Sequence[str | os.PathLike[str]]) -> list[Path]:
    """Return paths that can be read repeatedly; see `regular_file`."""
    return [regular_file(path) for path in paths]


def regular_file(path: str | os.PathLike[str]) -> Path:
    """Return a path, or that of a copy of what comes through the pipe that it names.

    The copy is removed when the program ends. Paths that cannot be read are returned as they are:
    opening them reports the reason.

    Raises
    ------
    InputError
        It is a terminal or another device, or nothing comes, or there is no room for the copy.
    """
    path = Path(path)
    descriptor = _standard_input() if path in _STANDARD_INPUTS else None
    name = path.name if descriptor is None else STANDARD_INPUT
    try:
        mode = path.stat().st_mode if descriptor is None else os.fstat(descriptor).st_mode
    except OSError as error:
        if descriptor is None:
            return path
        raise InputError(f"{name}: is closed; give a recording, or pipe one in") from error
    if descriptor is None and (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        return path
    if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
        what = "a terminal" if descriptor is not None and os.isatty(descriptor) else "a device"
        shown = path if descriptor is None else name
        raise InputError(f"{shown}: is {what}, not a recording; give a file, or pipe one in")
    return _copied(path if descriptor is None else descriptor, name)


def _standard_input() -> int:
    return 0 if sys.stdin is None else sys.stdin.fileno()


def _copied(source: Path | int, name: str) -> Path:
    """Return the path of a temporary file with all that comes from a pipe."""
    folder = tempfile.mkdtemp(prefix="cartoloop-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    copy = Path(folder) / name
    try:
        with _opened(source) as pipe, copy.open("wb") as file:
            while chunk := _next_chunk(pipe):
                file.write(chunk)
    except TimeoutError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise InputError(f"{name}: {error.strerror}; check the program before the pipe") from error
    except OSError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise InputError(
            f"{name}: cannot be copied to {folder} ({error.strerror}); set TMPDIR to a folder with "
            "room for the recording, or give it as a file"
        ) from error
    if copy.stat().st_size == 0:
        raise InputError(f"{name}: nothing came; check the program before the pipe")
    return copy


def _opened(source: Path | int) -> BinaryIO | io.FileIO:
    if isinstance(source, int):
        return open(source, "rb", buffering=0, closefd=False)
    return open_input(source)


def _next_chunk(pipe: BinaryIO | io.FileIO) -> bytes:
    """Return what comes next through a pipe, b"" at its end.

    A signal that comes just before a blocking read would wait for it: Python handles signals
    between its own steps.
    """
    if isinstance(pipe, io.FileIO) and hasattr(select, "poll"):
        poll = select.poll()
        poll.register(pipe, select.POLLIN)
        while not poll.poll(1e3 * _SIGNALS_S):
            pass
    return pipe.read(_CHUNK)
