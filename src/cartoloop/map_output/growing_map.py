# SPDX-License-Identifier: Apache-2.0
"""The map database of a growing map, saved repeatedly while mapping."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from cartoloop.errors import OutputError
from cartoloop.map_file.file_set import new_file_set
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.map_file.write import fill

if TYPE_CHECKING:
    from cartoloop.map_data import MapData


def save_growing_map(result: MapData, folder: Path) -> None:
    """Write a map database alone in place of the map in a folder; if that fails, it is kept.

    The database is made on the disk, row by row: no large block of memory is copied while the
    interpreter's lock is held, so that other threads keep running.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    with new_file_set(folder) as beside:
        try:
            with closing(sqlite3.connect(beside / FILE_NAME)) as database:
                # No other process opens the file before it is renamed.
                database.executescript("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF")
                fill(database, result)
        except sqlite3.Error as error:
            path = folder / FILE_NAME
            raise OutputError(f"{path}: cannot be written: {error}") from error
