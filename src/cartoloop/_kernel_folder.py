# SPDX-License-Identifier: Apache-2.0
"""The folder of compiled kernels: who compiles what while others wait, and what nobody uses.

Each version of the kernels has a folder of its own among those of others. Processes that share one
take turns through a file in it, which tells by its time when the folder was last used.
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
"""Folders that have not been used for so long are removed [s]."""

_TURNS = "turns"
_OWN_NAME = re.compile(r"[0-9a-f]{16}(-checked)?(\.\d+\.unused)?")
_PATIENCE_S = 60.0
"""So long this process waits for others, all in all [s]: one that rests may have many turns."""

_POLL_S = 0.01


def user_cache_folder() -> Path:
    """Return the folder for cached data that the operating system gives the user."""
    if configured := os.environ.get("CARTOLOOP_CACHE_DIR"):
        return Path(configured).absolute()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home())) / "cartoloop"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "cartoloop"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "cartoloop"


class Turns:
    """Whose turn it is: no two processes compile the same kernel.

    A turn is a lock on one byte of a file. The operating system lifts it when a process ends,
    however it does. Where files cannot be locked, nobody waits.

    Parameters
    ----------
    folder : that the processes share. It counts as used now; if nobody has used it before, those
        of other versions beside it that nobody uses any more are removed.
    """

    def __init__(self, folder: Path) -> None:
        self._file: int | None = None
        self._patience_s = _PATIENCE_S
        path = folder / _TURNS
        with suppress(OSError):
            is_new = not path.exists()
            self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
            os.utime(path)
            if is_new:
                remove_unused(folder.parent, time.time() - UNUSED_S)

    def is_taken(self, name: str) -> bool:
        """Return whether it is another process' turn; if not, it is ours, until `give_back`."""
        if self._file is None:
            return False
        try:
            _lock(self._file, crc32(name.encode()) >> 1)
        except (BlockingIOError, PermissionError):
            return True
        except OSError:
            return False
        return False

    def wait(self, name: str) -> None:
        """Wait until it is our turn; not forever, in case that another process has come to rest."""
        start = time.monotonic()
        while self.is_taken(name) and time.monotonic() - start < self._patience_s:
            time.sleep(_POLL_S)
        self._patience_s -= time.monotonic() - start

    def give_back(self, name: str) -> None:
        """Let another process have its turn."""
        if self._file is not None:
            with suppress(OSError):
                _unlock(self._file, crc32(name.encode()) >> 1)


def remove_unused(folders: Path, before: float) -> None:
    """Remove the folders among `folders` that have not been used since a time [s, epoch].

    Whoever uses one right then compiles anew what is missing.
    """
    for folder in folders.iterdir():
        with suppress(OSError):
            if _OWN_NAME.fullmatch(folder.name) and _last_use(folder) < before:
                # A name that nobody knows: it is there as a whole, or not at all.
                doomed = folder.rename(folder.with_name(f"{folder.name}.{os.getpid()}.unused"))
                shutil.rmtree(doomed, ignore_errors=True)


def _last_use(folder: Path) -> float:
    try:
        return (folder / _TURNS).stat().st_mtime
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
