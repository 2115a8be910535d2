# SPDX-License-Identifier: Apache-2.0
"""The folder that a run saves its map in: whether it can, and what may be replaced there.

A map is replaced by another of the same recording only, and not if it was edited, unless the user
allows more, and a finished map never by one of a run that was stopped or failed: that one goes into
a folder inside.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from cartoloop.errors import InputError, OutputError
from cartoloop.foreign_database import open_database
from cartoloop.journal.frames import FILE_NAME as JOURNAL
from cartoloop.journal.writer import in_use, is_locked
from cartoloop.map_file.file_set import FILES, repair_file_set
from cartoloop.map_file.run_header import read_journal
from cartoloop.map_file.schema import FILE_NAME

STOPPED = "stopped"
"""Folder, inside that of a finished map, for the map of a run that did not come to its end."""

SECOND = "second"
"""The same for a map of another recording that was saved there while this one was mapped."""


MapState = tuple[int, int, int]
"""What distinguishes one version of a map file from another."""


@dataclass(frozen=True, slots=True)
class SavedMap:
    """What is known of the map in a folder.

    Attributes
    ----------
    files : those of a map that are there.
    has_report : whether a report is among them, by itself or in the map file; if not, the files may
        be of another program, and nothing else is known.
    name : of the recording, or "".
    fingerprint : of the recording; "" where it is not known.
    finished : whether the run came to its end; true where that is not known.
    num_edits : edits of it that are in force.
    """

    files: tuple[str, ...]
    has_report: bool = False
    name: str = ""
    fingerprint: str = ""
    finished: bool = True
    num_edits: int = 0

    def is_of(self, name: str, fingerprint: str) -> bool:
        """Return whether the map is of a recording; earlier versions kept the name alone."""
        if self.fingerprint:
            return self.fingerprint == fingerprint
        return self.name == name != ""


@dataclass(frozen=True, slots=True)
class RunFolder:
    """Where a run saves its map.

    Attributes
    ----------
    path : the folder.
    name, fingerprint : of the recording; see `Report`.
    overwrite : whether the map of another recording may be replaced.
    adds : whether the new map is that in the folder with a session more, so that it may replace it;
        an interrupted run of another recording it may not.
    adds_for_good : the same, even if the run is stopped: it cannot be repeated.
    added_to : :func:`map_state` of the map that a session is added to. If another program changes
        it meanwhile, the new map is saved beside it.
    """

    path: Path
    name: str
    fingerprint: str
    overwrite: bool = False
    adds: bool = False
    adds_for_good: bool = False
    added_to: MapState | None = None

    def check(self) -> None:
        """Check that the folder can be written, or made, and that nothing else is lost by it.

        Nothing is made: this is for the time before the recording is read.

        Raises
        ------
        OutputError
            It cannot, or it holds another map.
        """
        if self.path.exists():
            prepare_folder(self.path)
            repair_file_set(self.path)
        else:
            _check_parents(self.path)
        for name in FILES:
            if (self.path / name).is_dir():
                raise OutputError(
                    f"{self.path / name}: is a folder where a file is to be written; choose "
                    "another output folder"
                )
        self._check_journal()
        saved = saved_map(self.path)
        if saved is None or self._may_replace(saved):
            return
        if self._is_base_changed():
            raise OutputError(f"{self.path}: was changed by another program just now; start again")
        what = f"another map (of {saved.name or 'a program'})"
        if saved.num_edits and saved.is_of(self.name, self.fingerprint):
            what = f"a map of this recording that was edited ({saved.num_edits} edits)"
        elif not saved.has_report:
            what = f"files that would be replaced ({', '.join(saved.files)})"
        raise OutputError(
            f"{self.path}: holds {what}; choose another output folder, or allow it with --overwrite"
        )

    def is_finished(self) -> bool:
        """Return whether the folder holds the finished map of the recording.

        That may be one to which the recording was added last.
        """
        saved = saved_map(self.path)
        if saved is None or not saved.finished:
            return False
        last = _last_session(self.path / FILE_NAME)
        return saved.is_of(self.name, self.fingerprint) or last == self.fingerprint != ""

    @property
    def has_journal(self) -> bool:
        """Whether the folder holds an interrupted run."""
        return (self.path / JOURNAL).is_file()

    def _check_journal(self) -> None:
        """Check that no interrupted run of another recording is lost.

        Raises
        ------
        OutputError
            One would be, or the folder is in use.
        """
        path = self.path / JOURNAL
        if is_locked(path):
            raise in_use(path)
        if not path.is_file() or self.overwrite:
            return
        try:
            header = read_journal(path, whole=False)[0]
        except InputError as error:
            raise OutputError(f"{error}, or allow it with --overwrite") from error
        run = SavedMap((JOURNAL,), True, header.name, header.fingerprint)
        if not run.is_of(self.name, self.fingerprint):
            raise OutputError(
                f"{self.path}: holds an interrupted run (of {header.name}); choose another output "
                "folder, or allow it with --overwrite"
            )

    def place(self, *, finished: bool) -> Path:
        """Return the folder to save a map in, which may be one inside; it exists.

        Parameters
        ----------
        finished : whether the run came to its end.

        Raises
        ------
        OutputError
            It cannot be written.
        """
        folder = prepare_folder(self.path)
        saved = saved_map(folder)
        is_better = finished or self.adds_for_good
        if saved is None or (self._may_replace(saved) and (is_better or not saved.finished)):
            return folder
        return prepare_folder(folder / (SECOND if finished else STOPPED))

    def why(self, place: Path) -> str:
        """Return the reason why a map is saved in a folder inside, as a clause; or ""."""
        if place == self.path:
            return ""
        if self._is_base_changed():
            return f", since {self.path} was changed by another program meanwhile"
        return f", since {self.path} holds a finished map"

    def _may_replace(self, saved: SavedMap) -> bool:
        if self.adds or self.adds_for_good:
            return not self._is_base_changed()
        if self.overwrite:
            return True
        return saved.is_of(self.name, self.fingerprint) and not saved.num_edits

    def check_base(self, place: Path) -> None:
        """Check, while files are replaced in a folder, that nothing is lost by it.

        Raises
        ------
        OutputError
            Another program has changed the map that a session is added to.
        """
        if place == self.path and self._is_base_changed():
            raise OutputError(f"{self.path}: was changed by another program meanwhile")

    def _is_base_changed(self) -> bool:
        return self.added_to is not None and map_state(self.path) != self.added_to


def map_state(folder: Path) -> MapState:
    """Return what distinguishes one version of a map file from another."""
    try:
        status = (folder / FILE_NAME).stat()
    except OSError:
        return (0, 0, 0)
    return status.st_ino, status.st_size, status.st_mtime_ns


def prepare_folder(out: str | PathLike[str]) -> Path:
    """Create the folder `out` if necessary, and check that it is writable.

    Raises
    ------
    OutputError
        It is not.
    """
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):  # which leaves nothing behind, even if it is killed
            pass
    except OSError as error:
        raise _cannot_write(folder, error.strerror) from error
    return folder


def saved_map(folder: Path) -> SavedMap | None:
    """Return what is known of the map in a folder; None if none of its files is there."""
    files = tuple(name for name in FILES if (folder / name).is_file())
    if not files:
        return None
    report = _report_in_json(folder / "report.json") or _report_in_map(folder / FILE_NAME)
    if report is None:
        return SavedMap(files)
    recording = report.get("input")
    return SavedMap(
        files,
        has_report=True,
        name=str(recording.get("name", "")) if isinstance(recording, Mapping) else "",
        fingerprint=str(report.get("fingerprint", "")),
        finished=bool(report.get("finished", True)),
        num_edits=len(edits) if isinstance(edits := report.get("edits"), list) else 0,
    )


def _report_in_json(path: Path) -> Mapping[str, Any] | None:
    try:
        report = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
    return report if isinstance(report, Mapping) else None


def _report_in_map(path: Path) -> Mapping[str, Any] | None:
    """Return the report in a map file, as a live run leaves it alone; None without one."""
    if not path.is_file():
        return None
    try:
        with closing(open_database(path, ["about"])) as database:
            row = database.execute("SELECT value FROM about WHERE key = 'report'").fetchone()
        report = json.loads(row[0])
    except (sqlite3.Error, ValueError, TypeError):
        return None
    return report if isinstance(report, Mapping) else None


def _last_session(path: Path) -> str:
    """Return the fingerprint of the last recording in a map file; "" where it is not known."""
    if not path.is_file():
        return ""
    try:
        with closing(open_database(path, ["sessions"])) as database:
            row = database.execute(
                "SELECT fingerprint FROM sessions ORDER BY session DESC LIMIT 1"
            ).fetchone()
        return str(row[0])
    except (sqlite3.Error, ValueError, TypeError):
        return ""


def _check_parents(folder: Path) -> None:
    """Check that a folder that does not exist can be made.

    Raises
    ------
    OutputError
        It cannot.
    """
    parent = next(path for path in folder.absolute().parents if path.exists())
    if not parent.is_dir():
        raise _cannot_write(folder, f"{parent} is no folder")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise _cannot_write(folder, f"nothing can be made in {parent}")


def _cannot_write(folder: Path, why: str | None) -> OutputError:
    return OutputError(f"{folder}: cannot write there: {why}; choose another output folder")
