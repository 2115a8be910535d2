# SPDX-License-Identifier: Apache-2.0
"""The map database of a growing map, saved repeatedly while mapping."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from cartoloop.errors import OutputError
from cartoloop.map_file.write import fill
from cartoloop.map_output.unfinished_file import unfinished_file

if TYPE_CHECKING:
    from cartoloop.map_data import MapData


def save_growing_map(result: MapData, path: Path) -> None:
    """Write a map database; if that fails, an existing file is kept.

    The database is made on the disk, row by row: no large block of memory is copied while the
    interpreter's lock is held, so that other threads keep running.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    with unfinished_file(path) as unfinished:
        try:
            with closing(sqlite3.connect(unfinished)) as database:
                # No other process opens the file before it is renamed.
                database.executescript("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF")
                fill(database, result)
        except sqlite3.Error as error:
            raise OutputError(f"{path}: cannot be written: {error}") from error
