# SPDX-License-Identifier: Apache-2.0
"""A map opened as it was edited."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from cartoloop.map_data import MapData
from cartoloop.map_editing.apply import AnyMap, apply_edits
from cartoloop.map_file.damage import damage_reported
from cartoloop.map_file.read import map_file_of, read_map

_MAX_DEPTH = 8
"""How many interrupted runs are opened, where each adds to the next."""


def open_map(path: str | PathLike[str]) -> MapData:
    """Return a map with its edits, given a map database or its folder.

    An interrupted run that adds a session to a map is opened with that map.

    Raises
    ------
    InputError
        It is not there, is no map database, is damaged, or was written by a newer program.
    """
    return _open(path, 0)


def _open(path: str | PathLike[str], depth: int) -> MapData:
    def open_base(base: Path) -> MapData:
        return _open(base, depth + 1)

    return as_edited(read_map(path, open_base if depth < _MAX_DEPTH else None), path)


def as_edited(original: AnyMap, path: str | PathLike[str]) -> AnyMap:
    """Return a map as mapped, which was read from a path, with its edits.

    Raises
    ------
    InputError
        An edit is damaged.
    """
    with damage_reported(map_file_of(path)):
        return apply_edits(original, original.edited_quality).map
