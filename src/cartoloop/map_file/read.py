# SPDX-License-Identifier: Apache-2.0
"""A map database as the map that it was made of."""

from __future__ import annotations

import json
import sqlite3
import zlib
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from cartoloop.arguments import as_path
from cartoloop.arrays import FloatArray
from cartoloop.config import Config
from cartoloop.errors import InputError
from cartoloop.foreign_database import open_database
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.map_data import MapData
from cartoloop.map_file.closure_tables import constraints_and_closures
from cartoloop.map_file.closure_tables_v2 import constraints_and_closures_v2
from cartoloop.map_file.file_set import repair_file_set
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
from cartoloop.submaps.finished_grid import FinishedGrid

Row = tuple[Any, ...]

_MAX_UNIT = 1e300  # of points [m]: times 2^15 still a number
_TABLES = [
    "about",
    "submaps",
    "nodes",
    "constraints",
    "closures",
    "matches",
    "statuses",
    "reasons",
    "trajectory",
    "sessions",
]
_FREE_CELLS, _CELLS_PER_BYTE = 2**24, 100  # of all submaps: a map is compressed to a twentieth
_FREE_SUBMAPS, _BYTES_PER_SUBMAP = 1000, 200  # of the file: a submap takes thousands
_MAX_CELLS = 2**27  # of one submap: a square of 500 m; more is no submap but a damaged file


def read_map(path: str | PathLike[str]) -> MapData:
    """Return the content of a map database, given the file or its folder.

    Raises
    ------
    InputError
        It is not there, is no map database, is damaged, or was written by a newer program.
    """
    file = as_path(path, "map")
    if file.is_dir():
        repair_file_set(file)
        file /= FILE_NAME
    with _opened(file) as database, _damage_reported(file):
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
            config=_config(about["config"]),
            report=_report(report),
            closures=closures,
            node_points=[_points(*row[5:]) for row in nodes],
            sessions=sessions_of(database, _report(report), trajectory[:, 1], graph),
        )


@contextmanager
def _opened(file: Path) -> Iterator[sqlite3.Connection]:
    """Yield the database, opened for reading."""
    if not file.is_file():
        raise InputError(
            f"{file}: is not there; give a folder that 'cartoloop map' wrote, or the file "
            f"{FILE_NAME} in one"
        )
    try:
        database = open_database(file, _TABLES)
        application_id = database.execute("PRAGMA application_id").fetchone()[0]
        version = database.execute("PRAGMA user_version").fetchone()[0]
    except sqlite3.Error as error:
        raise InputError(
            f"{file}: is no map database ({error}); map the recording again"
        ) from error
    with closing(database):
        if application_id != APPLICATION_ID:
            raise InputError(f"{file}: is a database, but no map; give one that cartoloop wrote")
        if version not in READABLE_VERSIONS:
            known = " and ".join(map(str, READABLE_VERSIONS))
            raise InputError(
                f"{file}: is of version {version}, this program knows {known}; "
                "use the program that wrote it, or map the recording again"
            )
        yield database


@contextmanager
def _damage_reported(file: Path) -> Iterator[None]:
    """Turn the errors that damaged content leads to into one for the user."""
    try:
        yield
    except (
        sqlite3.Error, zlib.error, ValueError, TypeError, KeyError, IndexError, OverflowError,
        AttributeError, RecursionError,
    ) as error:  # fmt: skip
        what = " ".join(str(error).split())
        raise InputError(
            f"{file}: is damaged ({type(error).__name__}: {what}); map the recording again"
        ) from error


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


def _config(saved: str) -> Config:
    """Return the configuration, with the present names of its keys.

    Parameters that only the program that wrote the file has are left out: they have no effect here.
    """
    content = json.loads(saved)
    sections = content if isinstance(content, dict) else {}
    search = sections.get("global_slam", {}).get("constraint_search", {})
    for old, new in _RENAMED.items():
        if old in search:
            search[new] = search.pop(old)
    return Config.model_validate(_known(content, Config))


def _known(content: Any, section: type[BaseModel]) -> Any:  # noqa: ANN401 - values of JSON
    """Return the content of a section without what it does not have."""
    if not isinstance(content, dict):
        return content
    known = {}
    for name, field in section.model_fields.items():
        if name in content:
            kind: Any = field.annotation
            is_section = isinstance(kind, type) and issubclass(kind, BaseModel)
            known[name] = _known(content[name], kind) if is_section else content[name]
    return known


_RENAMED = {
    "bound_length": "well_constrained_length",
    "every_nth_bound_node": "every_nth_well_constrained_node",
    "max_searches_of_bound_pair": "max_searches_of_well_constrained_pair",
}
"""Keys of ``global_slam.constraint_search``, before and now."""


def _graph(database: sqlite3.Connection) -> tuple[PoseGraph, Closures]:
    graph = PoseGraph()
    submaps = database.execute("SELECT x, y, theta FROM submaps ORDER BY submap").fetchall()
    nodes = database.execute("SELECT x, y, theta FROM nodes ORDER BY node").fetchall()
    graph.add_submaps(_poses(submaps))
    graph.add_nodes(_poses(nodes))
    if graph.num_submaps:
        graph.fix_submap(0)
    version = database.execute("PRAGMA user_version").fetchone()[0]
    read = constraints_and_closures_v2 if version == 2 else constraints_and_closures
    return graph, read(database, graph)


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
    if num_cells > _FREE_CELLS + _CELLS_PER_BYTE * num_bytes:
        raise ValueError(f"{num_cells} cells cannot stand in {num_bytes} bytes")
    return [_grid(row) for row in rows]


def _grid(row: Row) -> FinishedGrid:
    num_rows, num_cols, origin_x, origin_y, resolution, packed = row[4:]
    if not (0 <= num_rows * num_cols <= _MAX_CELLS and num_rows >= 0):
        raise ValueError(f"submap {row[0]} is {num_rows} by {num_cols} cells")
    cells = _unpacked(packed, num_rows * num_cols)
    array = np.frombuffer(cells, dtype=np.uint8).reshape(num_rows, num_cols)
    return FinishedGrid(array, float(origin_x), float(origin_y), float(resolution))


def _points(num_points: int, unit: float, numbers_of_unit: bytes) -> FloatArray:
    if not 0.0 <= float(unit) <= _MAX_UNIT:
        raise ValueError(f"points are in units of {unit} m")
    numbers = np.frombuffer(numbers_of_unit, dtype="<i2")
    return numbers.reshape(2, num_points).T * float(unit)


def _unpacked(packed: bytes, size: int) -> bytes:
    """Return the content of a zlib stream, which must be of this size: no more is ever made."""
    stream = zlib.decompressobj()
    content = stream.decompress(packed, size + 1)
    if len(content) != size:
        raise ValueError("a compressed field is too short or too long")
    return content


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
