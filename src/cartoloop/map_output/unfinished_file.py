# SPDX-License-Identifier: Apache-2.0
"""Files that are written completely or not at all."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path

from cartoloop.errors import OutputError

LEFT_AFTER_S = 3600.0
"""Age of an unfinished file from which nobody writes it, if its process does not run here [s]: it
may run on another machine that shares the folder."""


@contextmanager
def unfinished_file(path: Path) -> Iterator[Path]:
    """Yield the name of a file to be written, which becomes `path` when the body is done.

    If the body fails, it is removed, and an existing file at `path` is kept. Old unfinished files
    of killed processes are removed first.

    Raises
    ------
    OutputError
        The file system does not allow it.
    """
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    _remove_left(path)
    try:
        try:
            unfinished.unlink(missing_ok=True)
            yield unfinished
            unfinished.replace(path)
        except BaseException:
            unfinished.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from error


def _remove_left(path: Path) -> None:
    """Remove the unfinished files of processes that were killed."""
    for left in path.parent.glob(f".{escape(path.name)}.*"):
        with suppress(OSError):  # it does no harm where it cannot be removed
            pid = left.name.rpartition(".")[2]
            is_old = time.time() - left.stat().st_mtime > LEFT_AFTER_S
            if is_old and pid.isdecimal() and not _runs(int(pid)):
                left.unlink()


def _runs(pid: int) -> bool:
    """Return whether there is a process of a number on this machine."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
