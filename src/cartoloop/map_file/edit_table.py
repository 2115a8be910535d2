# SPDX-License-Identifier: Apache-2.0
"""The edits of a map, as rows of a map database."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from typing import Any

from cartoloop.map_data import Edit

MAX_EDITS = 1000
"""Edits of one map, at most, those undone among them: opening it applies them."""

MAX_TEXT = 1 << 20
"""Characters of the arguments of one edit, at most."""


def read_edits(database: sqlite3.Connection) -> tuple[Edit, ...]:
    """Return the edits; none where the file is of a version that knew none.

    Their arguments are JSON, and not checked further.

    Raises
    ------
    ValueError, TypeError
        A row is damaged, or there are too many.
    """
    has_table = "SELECT count(*) FROM sqlite_master WHERE name = 'edits'"
    if not database.execute(has_table).fetchone()[0]:
        return ()
    rows = database.execute(
        "SELECT edit, kind, arguments, is_undone FROM edits ORDER BY edit LIMIT ?", (MAX_EDITS + 1,)
    ).fetchall()
    if len(rows) > MAX_EDITS:
        raise ValueError(f"there are more than {MAX_EDITS} edits")
    if [row[0] for row in rows] != list(range(len(rows))):
        raise ValueError("rows of edits are missing")
    return tuple(_edit(*row[1:]) for row in rows)


def edit_rows(edits: Sequence[Edit]) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of the table."""
    for number, edit in enumerate(edits):
        arguments = json.dumps(edit.arguments, allow_nan=False, sort_keys=True)
        yield number, edit.kind, arguments, int(edit.is_undone)


def _edit(kind: object, arguments: object, is_undone: object) -> Edit:
    if not isinstance(kind, str) or not isinstance(arguments, str) or is_undone not in (0, 1):
        raise ValueError("a row of edits is damaged")
    if len(arguments) > MAX_TEXT:
        raise ValueError(f"an edit has {len(arguments)} characters of arguments")
    content = json.loads(arguments)
    if not isinstance(content, dict):
        raise ValueError("the arguments of an edit are no object")
    return Edit(kind, content, bool(is_undone))
