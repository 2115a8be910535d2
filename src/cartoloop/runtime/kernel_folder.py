# SPDX-License-Identifier: Apache-2.0
"""The folder of compiled kernels: locks between processes, and removal of unused folders.

Each version of the kernels has a folder of its own. Processes that share a folder lock kernels
through a file in it, whose modification time records when the folder was last used.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import time
from contextlib import suppress
from pathlib import Path
from zlib import crc32

UNUSED_S = 30 * 86400.0
"""Folders unused for longer are removed [s]: a month."""

_LOCKS = "turns"
"""Name of the file of locks."""

_OWN_NAME = re.compile(r"[0-9a-f]{16}(-checked)?(\.\d+\.unused)?")
_MAX_WAIT_S = 60.0
"""Total time that this process waits for others [s]: one that holds a lock may be suspended."""

_POLL_S = 0.01
"""Period of polling a lock [s]: short against compiling a kernel."""


def user_cache_folder() -> Path:
    """Return the user's folder for cached data, by the conventions of the operating system."""
    if configured := os.environ.get("CARTOLOOP_CACHE_DIR"):
        return Path(configured).absolute()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home())) / "cartoloop"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "cartoloop"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "cartoloop"


class KernelLocks:
    """Locks between processes, so that no two compile the same kernel.

    A lock is a lock on one byte of a file. The operating system releases it when a process ends,
    however it ends. Where files cannot be locked, no process waits.

    Parameters
    ----------
    folder : shared by the processes. It counts as used now; if it is new, unused folders of other
        versions beside it are removed.
    """

    def __init__(self, folder: Path) -> None:
        self._file: int | None = None
        self._max_wait_s = _MAX_WAIT_S
        path = folder / _LOCKS
        with suppress(OSError):
            is_new = not path.exists()
            self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
            os.utime(path)
            if is_new:
                remove_unused(folder.parent, time.time() - UNUSED_S)

    def acquire(self, name: str) -> bool:
        """Lock a kernel until `release`; return False if another process holds its lock."""
        if self._file is None:
            return True
        try:
            _lock(self._file, crc32(name.encode()) >> 1)
        except (BlockingIOError, PermissionError):
            return False
        except OSError:
            return True
        return True

    def wait(self, name: str) -> None:
        """Wait for a lock; not forever, because the other process may be suspended."""
        start = time.monotonic()
        while not self.acquire(name) and time.monotonic() - start < self._max_wait_s:
            time.sleep(_POLL_S)
        self._max_wait_s -= time.monotonic() - start

    def release(self, name: str) -> None:
        """Release the lock of a kernel."""
        if self._file is not None:
            with suppress(OSError):
                _unlock(self._file, crc32(name.encode()) >> 1)


def remove_unused(folders: Path, before: float) -> None:
    """Remove the folders among `folders` that have not been used since a time [s, epoch].

    A process that uses one at that moment compiles the missing kernels again.
    """
    for folder in folders.iterdir():
        with suppress(OSError):
            if _OWN_NAME.fullmatch(folder.name) and _last_use(folder) < before:
                # Renamed first, so that no process finds a part of it.
                doomed = folder.rename(folder.with_name(f"{folder.name}.{os.getpid()}.unused"))
                shutil.rmtree(doomed, ignore_errors=True)


def _last_use(folder: Path) -> float:
    try:
        return (folder / _LOCKS).stat().st_mtime
    except OSError:
        return max(path.stat().st_mtime for path in (folder, *folder.iterdir()))


if sys.platform == "win32":
    import msvcrt

    def _lock(file: int, byte: int) -> None:
        os.lseek(file, byte, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)

    def _unlock(file: int, byte: int) -> None:
        os.lseek(file, byte, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_UNLCK, 1)

else:
    import fcntl

    def _lock(file: int, byte: int) -> None:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, byte)

    def _unlock(file: int, byte: int) -> None:
        fcntl.lockf(file, fcntl.LOCK_UN, 1, byte)
