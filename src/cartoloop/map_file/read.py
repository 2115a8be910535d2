# SPDX-License-Identifier: Apache-2.0
"""A map database as the map that it was made of."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cartoloop.arguments import as_path
from cartoloop.arrays import FloatArray
from cartoloop.errors import InputError
from cartoloop.foreign_database import open_database
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.journal.frames import FILE_NAME as JOURNAL
from cartoloop.map_data import MapData
from cartoloop.map_file.adjustment_tables import read_adjustment_tables
from cartoloop.map_file.closure_tables import constraints_and_closures
from cartoloop.map_file.closure_tables_v2 import constraints_and_closures_v2
from cartoloop.map_file.damage import damage_reported, require_cells_to_fit
from cartoloop.map_file.edit_table import read_edits
from cartoloop.map_file.file_set import repair_file_set
from cartoloop.map_file.saved_config import config_of_json
from cartoloop.map_file.schema import (
    APPLICATION_ID,
    FILE_NAME,
    READABLE_VERSIONS,
)
from cartoloop.map_file.sessions import sessions_of
from cartoloop.map_file.tables import numbers_of
from cartoloop.plain_text import plain_values
from cartoloop.quality.verdict import Quality
from cartoloop.report import ConstraintSummary, InputSummary, Report
from cartoloop.sensor.packed_points import unpack_points
from cartoloop.submaps.finished_grid import FinishedGrid

if TYPE_CHECKING:
    from cartoloop.map_file.journal_map import OpenBase

Row = tuple[Any, ...]

_MAX_PLACE = 1e9
"""Largest number in the pose of a submap or node [m]: more than twice the way to the moon."""

_TABLES = [
    "about",
    "submaps",
    "nodes",
    "constraints",
    "closures",
    "matches",
    "trusted",
    "held",
    "statuses",
    "reasons",
    "trajectory",
    "edits",
    "sessions",
]
_FREE_SUBMAPS, _BYTES_PER_SUBMAP = 1000, 200  # of the file: a submap takes thousands


def read_map(path: str | PathLike[str], open_base: OpenBase | None = None) -> MapData:
    """Return the map as mapped, and its edits, given a map database or its folder.

    A folder without one may hold the journal of a run that was interrupted: then it is the map
    that the run had so far.

    Parameters
    ----------
    path : the file, or its folder.
    open_base : opens the map that an interrupted run adds a session to; without it, of such a run
        the session alone is returned.

    Raises
    ------
    InputError
        It is not there, is no map database, is damaged, or was written by a newer program.
    """
    given = as_path(path, "map")
    repair_file_set(given if given.is_dir() else given.parent)
    file = map_file_of(given)
    if file.name == JOURNAL:
        from cartoloop.map_file.journal_map import read_journal_map

        return read_journal_map(file, open_base)
    with _opened(file) as database, damage_reported(file):
        about: dict[str, str] = dict(_rows(database, "about"))
        graph, closures = _graph(database)
        nodes = _rows(database, "nodes")
        trajectory = _poses(_rows(database, "trajectory"), 8)
        report = plain_values(json.loads(about["report"]))
        return MapData(
            stamps=trajectory[:, 1].copy(),
            trajectory=trajectory[:, 2:5].copy(),
            local_trajectory=trajectory[:, 5:].copy(),
            graph=graph,
            node_scan_index=_scan_index(nodes, len(trajectory)),
            submap_grids=_grids(_rows(database, "submaps"), file.stat().st_size),
            config=config_of_json(about["config"]),
            report=_report(report),
            closures=closures,
            node_points=[unpack_points(*row[5:]) for row in nodes],
            edits=read_edits(database),
            edited_quality=_edited_quality(about),
            sessions=sessions_of(database, _report(report), trajectory[:, 1], graph),
        )


def map_file_of(path: str | PathLike[str]) -> Path:
    """Return the map database, given itself or its folder; a journal where there is no other."""
    file = as_path(path, "map")
    if not file.is_dir():
        return file
    database, journal = file / FILE_NAME, file / JOURNAL
    return journal if journal.is_file() and not database.is_file() else database


def require_map(path: str | PathLike[str]) -> None:
    """Check that there is a map of a version that can be read, before anything long begins.

    Raises
    ------
    InputError
        There is none.
    """
    given = as_path(path, "map")
    if not given.exists():
        raise _not_there(path)
    repair_file_set(given if given.is_dir() else given.parent)
    file = map_file_of(given)
    if file.name != JOURNAL:
        with _opened(file):
            pass


def _not_there(path: str | PathLike[str]) -> InputError:
    return InputError(
        f"{path}: is not there; give a folder that 'cartoloop map' wrote, or the file "
        f"{FILE_NAME} in one"
    )


@contextmanager
def _opened(file: Path) -> Iterator[sqlite3.Connection]:
    """Yield the database, opened for reading."""
    if not file.is_file():
        raise _not_there(file)
    advice = "map the recording again"
    if file.name != FILE_NAME:
        advice = (
            f"give a folder that 'cartoloop map' wrote, or the file {FILE_NAME} in one; "
            "a recording is mapped first, with 'cartoloop map'"
        )
    try:
        with file.open("rb") as opened:
            if not opened.read(1):
                raise InputError(f"{file}: is empty; {advice}")
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}; check the file") from error
    try:
        database = open_database(file, _TABLES)
        application_id = database.execute("PRAGMA application_id").fetchone()[0]
        version = database.execute("PRAGMA user_version").fetchone()[0]
    except sqlite3.Error as error:
        raise InputError(f"{file}: is no map database ({error}); {advice}") from error
    with closing(database):
        if application_id != APPLICATION_ID:
            raise InputError(f"{file}: is a database, but no map; give one that cartoloop wrote")
        if version not in READABLE_VERSIONS:
            first, last = min(READABLE_VERSIONS), max(READABLE_VERSIONS)
            raise InputError(
                f"{file}: is of version {version}, this program reads {first} to {last}; "
                "use the program that wrote it, or map the recording again"
            )
        yield database


def _rows(database: sqlite3.Connection, table: str) -> list[Row]:
    """Return a table's rows by their keys, which must count from 0 where they are numbers."""
    rows: list[Row] = database.execute(f"SELECT * FROM {table} ORDER BY 1").fetchall()
    if table != "about" and [row[0] for row in rows] != list(range(len(rows))):
        raise ValueError(f"rows of {table} are missing")
    return rows


def _poses(rows: Sequence[Row], num_columns: int = 3) -> FloatArray:
    array = numbers_of(rows, num_columns)
    if not np.isfinite(array).all():
        raise ValueError("a pose is not finite")
    return array


def _places(rows: Sequence[Row]) -> FloatArray:
    """Return poses of submaps or nodes, whose cells can be counted."""
    places = _poses(rows)
    if np.any(np.abs(places) > _MAX_PLACE):
        raise ValueError("a pose is out of all bounds")
    return places


def _graph(database: sqlite3.Connection) -> tuple[PoseGraph, Closures]:
    graph = PoseGraph()
    submaps = database.execute("SELECT x, y, theta FROM submaps ORDER BY submap").fetchall()
    nodes = database.execute("SELECT x, y, theta FROM nodes ORDER BY node").fetchall()
    graph.add_submaps(_places(submaps))
    graph.add_nodes(_places(nodes))
    if graph.num_submaps:
        graph.fix_submap(0)
    version = database.execute("PRAGMA user_version").fetchone()[0]
    read = constraints_and_closures_v2 if version == 2 else constraints_and_closures
    closures = read(database, graph)
    read_adjustment_tables(database, graph)
    return graph, closures


def _scan_index(nodes: Sequence[Row], num_scans: int) -> NDArray[np.int64]:
    scans = np.array([row[1] for row in nodes], dtype=np.int64)
    if np.any((scans < 0) | (scans >= num_scans)):
        raise ValueError("a node is of no scan")
    return scans


def _grids(rows: Sequence[Row], num_bytes: int) -> list[FinishedGrid]:
    """Return the grids of the submaps; no more of them than a file of this size can hold."""
    if len(rows) > _FREE_SUBMAPS + num_bytes // _BYTES_PER_SUBMAP:
        raise ValueError(f"{len(rows)} submaps cannot stand in {num_bytes} bytes")
    num_cells = sum(max(int(row[4]), 0) * max(int(row[5]), 0) for row in rows)
    require_cells_to_fit(num_cells, num_bytes)
    return [_grid(row) for row in rows]


def _grid(row: Row) -> FinishedGrid:
    num_rows, num_cols, origin_x, origin_y, resolution, packed = row[4:]
    place = float(origin_x), float(origin_y), float(resolution)
    return FinishedGrid.of_packed(packed, (num_rows, num_cols), *place)


def _edited_quality(about: dict[str, str]) -> Quality | None:
    saved = about.get("edited_quality")
    return None if saved is None else Quality.from_dict(plain_values(json.loads(saved)))


def _report(saved: dict[str, Any]) -> Report:
    quality = Quality.from_dict(saved["quality"]) if "quality" in saved else Quality()
    summary = InputSummary(**saved["input"])
    if not (isinstance(summary.scans, int) and 0 <= summary.scans < 2**32):
        raise ValueError(f"the number of scans is {summary.scans!r}")
    return Report(
        input=summary,
        nodes=saved["nodes"],
        submaps=saved["submaps"],
        constraints=ConstraintSummary(**saved["constraints"]),
        skipped=saved["skipped"],
        quality=quality,
        version=saved["version"],
        config_hash=saved["config_hash"],
        # Files of before have no such key; only finished maps were examined.
        finished=bool(saved.get("finished", quality.verdict != "unknown")),
        fingerprint=str(saved.get("fingerprint", "")),
        extra=saved["extra"],
    )
