# SPDX-License-Identifier: Apache-2.0
"""Databases of others, opened for reading: what a file of a few bytes may cost is bounded.

A file can define a table as a view without end, or a column that computes gigabytes.
"""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import quote

_STEPS_AT_A_TIME = 100_000
_FREE_STEPS, _STEPS_PER_BYTE = 50_000_000, 20
"""Steps of SQLite's machine: a row takes a few, and no fewer bytes."""

_FREE_BYTES = 1 << 20

_COMPUTED = re.compile(r"\bAS\s*\(|^\s*CREATE\s+VIRTUAL\b", re.IGNORECASE)


def open_database(
    path: Path, tables: Iterable[str], *, is_damaged: bool = False
) -> sqlite3.Connection:
    """Return a connection to a file that is only read, whose queries end.

    Parameters
    ----------
    path : the file; nothing is written beside it.
    tables : that will be queried; those that exist must be plain tables.
    is_damaged : whether a file that lacks its last pages is read as far as it goes.

    Raises
    ------
    sqlite3.Error
        It cannot be opened, or one of the tables is computed.
    """
    name = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
    database = sqlite3.connect(name, uri=True)
    try:
        _limit(database, path.stat().st_size)
        database.execute("PRAGMA trusted_schema=OFF")
        if is_damaged:
            database.execute("PRAGMA writable_schema=ON")
        for table in tables:
            _require_plain(database, table)
    except sqlite3.Error:
        database.close()
        raise
    return database


def _limit(database: sqlite3.Connection, num_bytes: int) -> None:
    """Have queries fail that make more than a file of this size can hold."""
    # A value cannot be longer than the file that it stands in.
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(num_bytes, _FREE_BYTES))
    left = _FREE_STEPS + _STEPS_PER_BYTE * num_bytes

    def is_too_much() -> bool:
        nonlocal left
        left -= _STEPS_AT_A_TIME
        return left < 0

    database.set_progress_handler(is_too_much, _STEPS_AT_A_TIME)


def _require_plain(database: sqlite3.Connection, table: str) -> None:
    query = "SELECT type, sql FROM sqlite_master WHERE name = ? COLLATE NOCASE"
    try:
        found = database.execute(query, (table,)).fetchall()
    except UnicodeDecodeError:
        raise sqlite3.DatabaseError(f"the definition of {table} is no text") from None
    for kind, sql in found:
        if kind != "table" or _COMPUTED.search(str(sql)):
            raise sqlite3.DatabaseError(f"{table} is no plain table")
