# SPDX-License-Identifier: Apache-2.0
"""The map that a live run goes on from: in its own folder, or in another one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from os import PathLike
from pathlib import Path

from cartoloop.errors import InputError
from cartoloop.journal.frames import FILE_NAME as JOURNAL
from cartoloop.journal.writer import in_use, is_locked
from cartoloop.map_data import MapData
from cartoloop.map_editing.open_map import open_map
from cartoloop.map_file.file_set import repair_file_set
from cartoloop.map_file.journal_map import base_of
from cartoloop.map_file.run_header import RunHeader, read_journal
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.map_output.output_folder import saved_map
from cartoloop.map_output.save import save
from cartoloop.merging import merge
from cartoloop.runs.base import is_same_folder
from cartoloop.sensor.pose import Pose
from cartoloop.session import MAIN_PART


def map_to_add_to(
    onto: MapData | str | PathLike[str], out: Path, note: Callable[[str], None]
) -> MapData:
    """Return the map that a live run adds a session to, which may be that in its own folder.

    Raises
    ------
    InputError, OutputError
        As `map_to_continue`.
    """
    if isinstance(onto, MapData):
        return onto
    if is_same_folder(onto, out):
        return map_to_continue(out, note)
    return open_map(onto)


def map_to_continue(folder: Path, note: Callable[[str], None]) -> MapData:
    """Return the map in the folder of a live run, which ended or was interrupted.

    What an interrupted run has in its journal is saved as the map of the folder first, together
    with the map that it added to itself, so that another interruption loses nothing of it.

    Parameters
    ----------
    folder : of the run.
    note : called with a line for the operator where something is to be done first.

    Raises
    ------
    InputError
        There is no map, it cannot be read, or the interrupted run is of a recording.
    OutputError
        Another run writes there, or the folder cannot be written.
    """
    repair_file_set(folder)
    file, journal = folder / FILE_NAME, folder / JOURNAL
    if is_locked(journal):
        raise in_use(journal)
    if not journal.is_file():
        return open_map(folder)
    header = read_journal(journal, whole=False)[0]
    if header.kind == "map":
        raise InputError(
            f"{folder}: holds an interrupted run of a recording ({header.recording[0]}); end that "
            f"first, with `cartoloop map LOG --resume {folder}`"
        )
    saved = saved_map(folder)
    if saved is None or saved.fingerprint != header.fingerprint:
        note(f"recovering the map of the interrupted run in {folder}")
        found = _recovered(folder, header)
        save(replace(found, report=replace(found.report, finished=False)), folder)
    journal.unlink()  # the map in the folder has all of it
    return open_map(file)


def _recovered(folder: Path, header: RunHeader) -> MapData:
    """Return the map of an interrupted run, together with the one that it added to."""
    file, journal = folder / FILE_NAME, folder / JOURNAL
    found = open_map(journal)
    if not header.continues or base_of(header, folder, open_map) is not None:
        return found
    # A journal of an earlier program, or a map that was changed meanwhile: the session is alone.
    if not file.is_file():
        return found
    if not found.graph.num_nodes:
        return open_map(file)
    merged = merge([open_map(file), found])
    return replace(merged, report=replace(merged.report, fingerprint=header.fingerprint))


def last_pose(base: MapData) -> Pose | None:
    """Return where the robot was at the last scan of a map; None if that is apart from the map."""
    if not len(base.trajectory) or base.sessions[-1].part != MAIN_PART:
        return None
    x, y, theta = base.trajectory[-1].tolist()
    return Pose(x, y, theta)
