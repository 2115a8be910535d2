# SPDX-License-Identifier: Apache-2.0
"""The map of an earlier live run, to be continued by another one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from cartoloop.errors import InputError
from cartoloop.journal.frames import FILE_NAME as JOURNAL
from cartoloop.journal.writer import in_use, is_locked
from cartoloop.map_data import MapData
from cartoloop.map_file.file_set import repair_file_set
from cartoloop.map_file.journal_map import read_journal_map
from cartoloop.map_file.read import read_map
from cartoloop.map_file.run_header import read_journal
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.map_output.save import save
from cartoloop.merging import merge
from cartoloop.run_journal import nothing_to_resume
from cartoloop.sensor.pose import Pose
from cartoloop.session import MAIN_PART


def map_to_continue(folder: Path, note: Callable[[str], None]) -> MapData:
    """Return the map in the folder of a live run, which ended or was interrupted.

    What an interrupted run has in its journal is saved as the map of the folder first, joined with
    the map that it continued itself, so that another interruption loses nothing of it.

    Parameters
    ----------
    folder : of the run.
    note : called with a line for the operator where something is to be done first.

    Raises
    ------
    InputError
        The map cannot be read, or the interrupted run is of a recording.
    OutputError
        There is no map, another run writes there, or the folder cannot be written.
    """
    repair_file_set(folder)
    file, journal = folder / FILE_NAME, folder / JOURNAL
    if is_locked(journal):
        raise in_use(journal)
    if not journal.is_file():
        if not file.is_file():
            raise nothing_to_resume(folder)
        return read_map(file)
    header = read_journal(journal, whole=False)[0]
    if header.kind == "map":
        raise InputError(
            f"{folder}: holds an interrupted run of a recording ({header.name}); end that first, "
            f"with `cartoloop map LOG --resume {folder}`"
        )
    note(f"recovering the map of the interrupted run in {folder}")
    maps = [read_map(file)] if header.continues and file.is_file() else []
    interrupted = read_journal_map(journal)
    if interrupted.graph.num_nodes or not maps:
        maps.append(interrupted)
    found = maps[0] if len(maps) == 1 else merge(maps)
    found = replace(found, report=replace(found.report, finished=False))
    save(found, folder)
    journal.unlink()
    return found


def last_pose(base: MapData) -> Pose | None:
    """Return where the robot was at the last scan of a map; None if that is apart from the map."""
    if not len(base.trajectory) or base.sessions[-1].part != MAIN_PART:
        return None
    x, y, theta = base.trajectory[-1].tolist()
    return Pose(x, y, theta)
