# SPDX-License-Identifier: Apache-2.0
"""A map that a command opens, with a line where a run of it was interrupted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from cartoloop.result import Result


def open_map(path: Path) -> Result:
    """Return the map of a folder or file; say so where it is that of an interrupted run.

    Raises
    ------
    InputError
        It is not there, is no map, is damaged, or was written by a newer program.
    """
    from cartoloop.journal.frames import FILE_NAME as JOURNAL
    from cartoloop.journal.writer import is_locked
    from cartoloop.map_file.schema import FILE_NAME
    from cartoloop.result import load_map

    result = load_map(path)
    journal = path / JOURNAL
    if journal.is_file():
        state = "goes on" if is_locked(journal) else "was interrupted"
        what = "this is its map so far"
        if (path / FILE_NAME).is_file():
            what = f"this is the map before it; give {journal} for its map so far"
        how = "" if is_locked(journal) else _how_to_go_on(path)
        typer.echo(f"note: a run in {path} {state}; {what}{how}", err=True)
    return result


def _how_to_go_on(folder: Path) -> str:
    """Return by which command the interrupted run in a folder is resumed, as a clause."""
    from cartoloop.runs.journal import interrupted_run

    run = interrupted_run(folder)
    if run is None:
        return ""
    if run.header.kind == "live":
        return f"; `cartoloop live SOURCE --resume {folder}` goes on with it"
    recording, _ = run.header.recording
    return f"; `cartoloop map {recording} --resume {folder}` goes on with it"
