# SPDX-License-Identifier: Apache-2.0
"""A result as the bytes of a map database."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.global_slam.closure_matches import UPPER
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.map_file.adjustment_tables import held_rows, trusted_rows
from cartoloop.map_file.edit_table import edit_rows
from cartoloop.map_file.schema import APPLICATION_ID, SCHEMA_VERSION, TABLES
from cartoloop.map_file.sessions import session_rows
from cartoloop.sensor.packed_points import pack_points
from cartoloop.version import __version__

if TYPE_CHECKING:
    from cartoloop.global_slam.closures import Closures
    from cartoloop.global_slam.pose_graph import PoseGraph
    from cartoloop.map_data import MapData
    from cartoloop.report import Report
    from cartoloop.submaps.finished_grid import FinishedGrid

Row = tuple[Any, ...]

_ROWS_AT_A_TIME = 500


def map_bytes(result: MapData) -> bytes:
    """Return a result as the content of ``map.cartoloop``; the same result, the same bytes."""
    with closing(sqlite3.connect(":memory:")) as database:
        fill(database, result)
        return database.serialize()


def fill(database: sqlite3.Connection, result: MapData) -> None:
    """Write a result into an empty database; of an edited map, the map as mapped and its edits."""
    edits, edited_quality = result.edits, result.edited_quality
    if result.original is not None:
        result, edited_quality = result.original, result.report.quality
    database.executescript(
        f"PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {SCHEMA_VERSION};{TABLES}"
    )
    _insert(database, "about", _about(result))
    if edited_quality is not None:
        verdict = json.dumps(asdict(edited_quality), allow_nan=False)
        _insert(database, "about", iter([("edited_quality", verdict)]))
    _insert(database, "submaps", _submaps(result.submap_grids, result.graph.submap_poses))
    _insert(database, "nodes", _nodes(result))
    _insert(database, "constraints", _constraints(result.graph))
    _insert(database, "closures", _closures(result.closures, result.graph))
    _insert(database, "trusted", trusted_rows(result.graph))
    _insert(database, "held", held_rows(result.graph))
    _insert(database, "matches", _matches(result.closures))
    _insert(database, "statuses", iter([(code.value, code.text) for code in Status]))
    _insert(database, "reasons", iter([(code.value, code.text) for code in Reason]))
    _insert(database, "trajectory", _trajectory(result))
    _insert(database, "edits", edit_rows(edits))
    _insert(database, "sessions", session_rows(result.sessions))
    database.commit()


def report_without_times(report: Report) -> dict[str, Any]:
    """Return the part of a report that is the same in each run."""
    return {
        "input": asdict(report.input),
        "nodes": report.nodes,
        "submaps": report.submaps,
        "constraints": asdict(report.constraints),
        "skipped": report.skipped,
        "quality": asdict(report.quality),
        "version": report.version,
        "config_hash": report.config_hash,
        "finished": report.finished,
        "fingerprint": report.fingerprint,
        "extra": report.extra,
    }


def _insert(database: sqlite3.Connection, table: str, rows: Iterator[Row]) -> None:
    first = next(rows, None)
    if first is None:
        return
    values = f"INSERT INTO {table} VALUES ({','.join('?' * len(first))})"
    database.execute(values, first)
    database.executemany(values, rows)


def _about(result: MapData) -> Iterator[Row]:
    yield "name", result.report.input.name
    # the result does not depend on the threads
    yield "config", result.config.model_dump_json(exclude={"global_slam": {"num_threads"}})
    yield "report", json.dumps(report_without_times(result.report), allow_nan=False)
    yield "program", f"cartoloop {__version__}"


def _submaps(grids: Sequence[FinishedGrid], poses: FloatArray) -> Iterator[Row]:
    for index, (grid, pose) in enumerate(zip(grids, poses.tolist(), strict=True)):
        place = (grid.origin_x, grid.origin_y, grid.resolution)
        yield index, *pose, *grid.shape, *place, grid.packed


def _nodes(result: MapData) -> Iterator[Row]:
    nothing = np.zeros((0, 2))
    for index, scan, *pose in _rows(result.node_scan_index, *result.graph.node_poses.T):
        points = result.node_points[index] if index < len(result.node_points) else nothing
        yield index, scan, *pose, len(points), *pack_points(points)


def _constraints(graph: PoseGraph) -> Iterator[Row]:
    others = np.flatnonzero(graph.kinds != ConstraintKind.LOOP_CLOSURE)
    return _some_rows(
        others,
        graph.kinds[others],
        graph.index_a[others],
        graph.index_b[others],
        *graph.relative_poses[others].T,
        *graph.informations[others][:, *UPPER].T,
    )


def _closures(closures: Closures, graph: PoseGraph) -> Iterator[Row]:
    place = np.full(len(closures), np.nan)  # NaN is stored as NULL
    in_graph = np.flatnonzero(graph.closure_rows >= 0)
    place[graph.closure_rows[in_graph]] = in_graph
    requested = closures.num_requested
    of_all = (
        closures.submap,
        closures.node,
        closures.status,
        closures.reason,
        closures.search_status,
        place,
    )
    of_requests = (
        closures.node_submap,
        *closures.predicted.T,
        closures.linear_window,
        closures.angular_window,
        closures.min_score,
        closures.requested_at,
    )
    yield from _rows(*(column[:requested] for column in of_all), *of_requests)
    nothing = np.broadcast_to(np.nan, len(closures) - requested)
    of_others = [column[requested:] for column in of_all]
    yield from _rows(*of_others, *([nothing] * len(of_requests)), first=requested)


def _matches(closures: Closures) -> Iterator[Row]:
    table, num_found = closures.match_table, closures.num_found
    columns = (
        table.row,
        *table.tf_submap_node.T,
        *table.information.T,
        table.residual,
        *table.moved.T,
    )
    of_searches = (table.score, table.runner_up, table.joined_at)
    yield from _rows(*(column[:num_found] for column in columns), *of_searches)
    nothing = np.broadcast_to(np.nan, len(table.row) - num_found)
    of_last_pass = [column[num_found:] for column in columns]
    yield from _rows(*of_last_pass, *([nothing] * len(of_searches)), first=num_found)


def _trajectory(result: MapData) -> Iterator[Row]:
    return _rows(result.stamps, *result.trajectory.T, *result.local_trajectory.T)


def _rows(*columns: NDArray[Any], first: int = 0) -> Iterator[Row]:
    """Yield the rows of a table, each with its number, from `first` on.

    They are made in blocks, so that other threads never wait long for the interpreter.
    """
    return _some_rows(np.arange(first, first + len(columns[0])), *columns)


def _some_rows(*columns: NDArray[Any]) -> Iterator[Row]:
    """Yield the rows of a table, in blocks."""
    for done in range(0, len(columns[0]), _ROWS_AT_A_TIME):
        some = (column[done : done + _ROWS_AT_A_TIME].tolist() for column in columns)
        yield from zip(*some, strict=True)
