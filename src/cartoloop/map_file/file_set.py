# SPDX-License-Identifier: Apache-2.0
"""The files of a map, replaced as one: none of an earlier map ever lies beside one of a later.

New files are written into a hidden folder inside the output folder. When all are on the disk, that
folder gets another name, and from then on the new map is the valid one: the old files are removed,
then the new ones are moved in, which takes about a millisecond. If the process is killed within it,
the next program that opens the folder does the rest.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from cartoloop.errors import OutputError
from cartoloop.journal.frames import FILE_NAME as JOURNAL
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.stop_request import StopRequest

try:
    import fcntl
except ImportError:  # Windows has no such locks; there, two runs must not share a folder
    fcntl = None  # type: ignore[assignment]

FILES = (
    "map.pgm",
    "map.yaml",
    "map.png",
    "trajectory.tum",
    "local_trajectory.tum",
    "graph.g2o",
    "nodes.csv",
    "closures.csv",
    "map.cartoloop",
    "config.toml",
    "report.json",
)
"""The files of a map, each after those that it names."""

UNFINISHED = ".unfinished"
"""Folder of the new files while they are written; worthless after a kill."""

COMPLETE = ".complete"
"""The same folder when all of them are on the disk: the old ones are removed next."""

REPLACING = ".replacing"
"""A complete folder of files that replace those of the same names, and no others."""

MOVING = ".moving"
"""The same folder when the old ones are removed: its files are moved to where they belong."""


def require_no_map_file(path: Path) -> None:
    """Check that a file that is to be written is none of a map, which would be lost or mixed.

    Raises
    ------
    OutputError
        It is.
    """
    if path.name in (*FILES, JOURNAL) and any(
        path.with_name(name).is_file() for name in (FILE_NAME, JOURNAL)
    ):
        raise OutputError(
            f"{path}: is a file of a map, which would be damaged; give another name, or another "
            "folder"
        )


@contextmanager
def new_file_set(folder: Path, stop: StopRequest | None = None) -> Iterator[Path]:
    """Yield a folder for the files of a new map, which replaces the map in `folder` in the end.

    If the body fails or is interrupted, the map in `folder` stays as it was.

    Parameters
    ----------
    folder : exists. Other files in it than `FILES` are not touched.
    stop : a stop that it notes does not interrupt the replacement.

    Raises
    ------
    OutputError
        The file system does not allow it.
    """
    with _swapped(folder, COMPLETE, stop or StopRequest()) as beside:
        yield beside


@contextmanager
def replaced_files(folder: Path) -> Iterator[Path]:
    """Yield a folder for files that replace those of the same names in `folder` in the end.

    As `new_file_set`, but all other files in `folder` stay.

    Raises
    ------
    OutputError
        The file system does not allow it.
    """
    with _swapped(folder, REPLACING, StopRequest()) as beside:
        yield beside


@contextmanager
def _swapped(folder: Path, complete: str, stop: StopRequest) -> Iterator[Path]:
    """Yield the folder of unfinished files, which is called `complete` when they are."""
    beside = folder / UNFINISHED
    try:
        with _locked(folder):
            complete_file_set(folder)
            try:
                shutil.rmtree(beside, ignore_errors=True)
                beside.mkdir()
                yield beside
                for path in beside.iterdir():
                    _check_is_no_folder(folder / path.name)
                    _to_disk(path)
                _to_disk(beside)
            except BaseException:
                shutil.rmtree(beside, ignore_errors=True)
                raise
            with stop.shielded():
                beside.rename(folder / complete)
                complete_file_set(folder)
    except OSError as error:
        place = error.filename or folder
        raise OutputError(
            f"{place}: cannot be written: {error.strerror}; choose another output folder"
        ) from error


def repair_file_set(folder: Path) -> None:
    """Complete a replacement that was cut short in a folder, if there is one to complete.

    Where that is not allowed, as in a folder that can only be read, nothing happens.
    """
    if any((folder / name).is_dir() for name in (COMPLETE, REPLACING, MOVING)):
        with suppress(OSError), _locked(folder):
            complete_file_set(folder)


def complete_file_set(folder: Path) -> None:
    """Put the files of a complete set in their places, from whatever step it was left at."""
    moving = folder / MOVING
    for complete in (folder / COMPLETE, folder / REPLACING):
        if complete.is_dir():
            for name in reversed(FILES if complete.name == COMPLETE else _names(complete)):
                (folder / name).unlink(missing_ok=True)
            complete.rename(moving)
    if moving.is_dir():
        for name in _names(moving):
            (moving / name).replace(folder / name)
        moving.rmdir()
        _to_disk(folder)


def _names(folder: Path) -> list[str]:
    """Return the names of the files in a folder, each after those that it names."""
    names = {path.name for path in folder.iterdir()}
    return [name for name in FILES if name in names] + sorted(names.difference(FILES))


def _check_is_no_folder(path: Path) -> None:
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))


def remove_file_set(folder: Path) -> None:
    """Remove the files of a map, and the folder if it holds nothing else.

    Raises
    ------
    OutputError
        The file system does not allow it.
    """
    try:
        for name in FILES:
            (folder / name).unlink(missing_ok=True)
        with suppress(OSError):  # it holds other files
            folder.rmdir()
    except OSError as error:
        raise OutputError(f"{folder}: cannot be removed: {error.strerror}") from error


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Wait until no other process replaces the files in a folder, and keep others from it."""
    with ExitStack() as stack:
        if fcntl is not None:
            descriptor = os.open(folder, os.O_RDONLY)
            stack.callback(os.close, descriptor)  # which unlocks it, as the end of a process does
            with suppress(OSError):  # a file system without locks
                fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield


def _to_disk(path: Path) -> None:
    """Wait until a file or a folder is on the disk, so that it survives a loss of power."""
    if os.name == "nt" and path.is_dir():
        return  # folders cannot be opened there
    descriptor = os.open(path, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system that has no such call
            os.fsync(descriptor)
    finally:
        os.close(descriptor)
