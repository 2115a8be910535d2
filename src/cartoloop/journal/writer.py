# SPDX-License-Identifier: Apache-2.0
"""The journal as a file that grows: records go to the system four times a second, and are synced.

A killed process loses what it has not passed to the system: a quarter of a second. A loss of power
loses what was not synced: a second. Both are done by threads of their own, since a slow disk must
not hold up the mapping.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Event, Lock, Thread
from time import monotonic

from cartoloop.errors import OutputError
from cartoloop.journal.frames import PREAMBLE, Kind, frame_bytes, record_bytes

try:
    import fcntl
except ImportError:  # Windows has no such locks; there, two runs must not share a folder
    fcntl = None  # type: ignore[assignment]

WRITE_PERIOD_S = 0.25
"""Period at which records are passed to the system [s]."""

LATE_S = 0.5
"""This long after the last write, the thread that appends a record writes: where other programs use
all processors, the one in the background may wait long for its turn [s]."""

SYNC_PERIOD_S = 1.0
"""Period at which the system is asked to put them on the disk [s]."""

MAX_WAITING_BYTES = 256 << 20
"""Records that wait for a full disk; with more, the journal ends there [bytes]."""


class JournalWriter:
    """Appends records to a journal, in the background, until it is closed.

    Parameters
    ----------
    path : the file.
    header : payload of the first record of a new file; None: the file is continued.
    kept_size : returns the size of the part of it that is kept then [bytes]; called when no other
        process can write it.
    on_failure : called with one line when the file cannot be written, in any thread; it is tried
        again. Called again only when something was written in between.

    Raises
    ------
    OutputError
        Another process writes the same journal.
    """

    def __init__(
        self,
        path: Path,
        on_failure: Callable[[str], None],
        *,
        header: bytes | None = None,
        kept_size: Callable[[], int] | None = None,
    ) -> None:
        self._path = path
        self._on_failure = on_failure
        self._lock = Lock()
        self._waiting: list[bytes] = []
        self._unwritten = bytearray()
        if header is not None:
            self._unwritten += PREAMBLE + frame_bytes([record_bytes(Kind.HEADER, header)])
        self._size = 0
        self._descriptor: int | None = None
        self._has_failed = False
        self._is_full = False
        self._needs_sync = False
        self._end = Event()
        self._writing = Lock()
        self._late_at = monotonic() + LATE_S
        self.num_written = 0
        if kept_size is not None:
            self._descriptor = _locked(path)
            self._size = self._kept(self._descriptor, kept_size)
        else:
            _refuse_if_locked(path)
            _remove_unfinished(path)
            self._write()
        self._threads = [
            Thread(target=self._repeat, args=task, name="journal", daemon=True)
            for task in ((self._write, WRITE_PERIOD_S), (self._sync, SYNC_PERIOD_S))
        ]
        for thread in self._threads:
            thread.start()

    def append(self, kind: int, payload: bytes) -> None:
        """Add a record; returns at once, after a write to the system at most. For any thread."""
        record = record_bytes(kind, payload)
        with self._lock:
            if not self._is_full:
                self._waiting.append(record)
        if monotonic() > self._late_at:
            self._write()

    def flush(self) -> None:
        """Pass all records to the system, and wait until they are on the disk."""
        self._write()
        self._sync()

    def close(self) -> None:
        """Write what is left and release the file; nothing may be appended any more."""
        if self._end.is_set():
            return
        self._end.set()
        for thread in self._threads:
            thread.join()
        self.flush()
        if self._descriptor is not None:
            os.close(self._descriptor)  # which unlocks it
            self._descriptor = None

    def remove(self) -> None:
        """Close and remove the file: the run has come to its end."""
        self.close()
        with suppress(OSError):
            self._path.unlink(missing_ok=True)

    def _kept(self, descriptor: int, kept_size: Callable[[], int]) -> int:
        """Cut off what is not whole at the end of a file; return its size then."""
        try:
            size = kept_size()
            os.ftruncate(descriptor, size)
        except BaseException:
            os.close(descriptor)
            raise
        return size

    def _repeat(self, task: Callable[[], None], period_s: float) -> None:
        while not self._end.wait(period_s):
            task()

    def _write(self) -> None:
        """Write the records that wait, as one frame."""
        with self._writing:
            with self._lock:
                records, self._waiting = self._waiting, []
            self._late_at = monotonic() + LATE_S
            if records:
                self._unwritten += frame_bytes(records)
            try:
                if self._is_gone():
                    self._begin_again()
                elif self._unwritten and self._descriptor is not None:
                    self._append(self._descriptor)
            except OSError as error:
                self._note_failure(error)

    def _append(self, descriptor: int) -> None:
        """Write at the end of the last whole frame: what a failure left there is replaced."""
        view = memoryview(bytes(self._unwritten))
        os.lseek(descriptor, self._size, os.SEEK_SET)
        while view:
            view = view[os.write(descriptor, view) :]
        self._size += len(self._unwritten)
        self.num_written += len(self._unwritten)
        self._unwritten = bytearray()
        self._needs_sync = True
        self._has_failed = False

    def _sync(self) -> None:
        with self._writing:
            if not self._needs_sync or self._descriptor is None:
                return
            self._needs_sync = False
            copy = os.dup(self._descriptor)
        try:
            # Without the lock: it may take seconds.
            with suppress(OSError):  # a file system that has no such call
                os.fsync(copy)
        finally:
            os.close(copy)

    def _is_gone(self) -> bool:
        """Return whether the file is not there: not yet, or its folder was removed."""
        if self._descriptor is None:
            return True
        try:
            return self._path.stat().st_ino != os.fstat(self._descriptor).st_ino
        except FileNotFoundError:
            return True

    def _begin_again(self) -> None:
        """Make the file, with what was written before if it was removed."""
        if self._descriptor is not None and is_locked(self._path):
            raise OSError(errno.EBUSY, "another run writes there")
        self._path.parent.mkdir(parents=True, exist_ok=True)
        beside = self._path.with_name(f"{_unfinished_prefix(self._path)}{os.getpid()}")
        removed = self._descriptor
        descriptor = os.open(beside, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o666)
        try:
            _lock(descriptor, self._path)
            if removed is not None:
                with (
                    os.fdopen(os.dup(removed), "rb") as old,
                    os.fdopen(os.dup(descriptor), "wb") as new,
                ):
                    os.lseek(old.fileno(), 0, os.SEEK_SET)
                    shutil.copyfileobj(old, new)
                os.ftruncate(descriptor, self._size)
            self._append(descriptor)
            beside.replace(self._path)
        except BaseException:
            os.close(descriptor)
            with suppress(OSError):
                beside.unlink(missing_ok=True)
            raise
        self._descriptor = descriptor
        if removed is not None:
            os.close(removed)

    def _note_failure(self, error: OSError) -> None:
        if len(self._unwritten) > MAX_WAITING_BYTES:
            with self._lock:
                self._is_full = True
        if not self._has_failed:
            self._has_failed = True
            self._on_failure(
                f"{self._path}: cannot be written: {error.strerror}; it is tried again"
            )


def is_locked(path: Path) -> bool:
    """Return whether another process writes a journal."""
    if fcntl is None or not path.exists():
        return False
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        return False
    finally:
        os.close(descriptor)
    return False


def _unfinished_prefix(path: Path) -> str:
    """Return how the name of a journal begins until it has its header; the process follows."""
    return f".{path.name}."


def _remove_unfinished(path: Path) -> None:
    """Remove what processes left that were killed before their journal had its header."""
    for unfinished in path.parent.glob(f"{_unfinished_prefix(path)}*"):
        if not is_locked(unfinished):
            with suppress(OSError):  # it does no harm where it cannot be removed
                unfinished.unlink(missing_ok=True)


def _refuse_if_locked(path: Path) -> None:
    if is_locked(path):
        raise in_use(path)


def _locked(path: Path) -> int:
    """Return a descriptor of an existing journal, locked."""
    try:
        descriptor = os.open(path, os.O_RDWR)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written: {error.strerror}; make it writable to resume the run"
        ) from error
    try:
        _lock(descriptor, path)
    except OutputError:
        os.close(descriptor)
        raise
    return descriptor


def _lock(descriptor: int, path: Path) -> None:
    if fcntl is None:
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise in_use(path) from None
    except OSError:  # a file system without locks
        pass


def in_use(path: Path) -> OutputError:
    """Return the error of a journal that another process writes."""
    return OutputError(
        f"{path.parent}: another run writes there; wait for its end, or choose another output "
        "folder"
    )
