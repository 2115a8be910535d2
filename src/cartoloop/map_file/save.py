# SPDX-License-Identifier: Apache-2.0
"""A result as the bytes of a map database."""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict
from itertools import chain, count
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import cartoloop
from cartoloop.map_file.schema import APPLICATION_ID, REJECTED, SCHEMA_VERSION, TABLES

if TYPE_CHECKING:
    from cartoloop.global_slam.loop_closure import Closures
    from cartoloop.global_slam.pose_graph import PoseGraph
    from cartoloop.map_output.report import Report
    from cartoloop.map_output.result import Result
    from cartoloop.submaps.finished_grid import FinishedGrid

FloatArray = NDArray[np.float64]
Row = tuple[Any, ...]

POINT_UNIT = 0.001
"""Points are kept to a millimetre, or where they lie further than 32 m, as finely as they fit."""

_MAX_INT16 = 32767
_ROWS_AT_A_TIME = 500
_UPPER = np.triu_indices(3)


def map_bytes(result: Result) -> bytes:
    """Return a result as the content of ``map.cartoloop``; the same result, the same bytes."""
    with closing(sqlite3.connect(":memory:")) as database:
        fill(database, result)
        return database.serialize()


def fill(database: sqlite3.Connection, result: Result) -> None:
    """Write a result into an empty database."""
    database.executescript(
        f"PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {SCHEMA_VERSION};{TABLES}"
    )
    _insert(database, "about", _about(result))
    _insert(database, "submaps", _submaps(result.submap_grids, result.graph.submap_poses))
    _insert(database, "nodes", _nodes(result))
    _insert(database, "constraints", _constraints(result.graph, result.rejected))
    _insert(database, "trajectory", _trajectory(result))
    database.commit()


def report_without_times(report: Report) -> dict[str, Any]:
    """Return what of a report is the same in each run."""
    return {
        "input": asdict(report.input),
        "nodes": report.nodes,
        "submaps": report.submaps,
        "constraints": asdict(report.constraints),
        "skipped": report.skipped,
        "version": report.version,
        "config_hash": report.config_hash,
        "extra": report.extra,
    }


def pack_points(points: NDArray[np.floating]) -> tuple[float, bytes]:
    """Return the unit [m] of points (n, 2) and their whole numbers of it.

    They are not compressed: noise is not smaller for it.
    """
    furthest = float(np.abs(points).max(initial=0.0))
    unit = max(POINT_UNIT, furthest / _MAX_INT16)
    numbers = np.rint(points.T / unit).astype("<i2")
    return unit, numbers.tobytes()


def _insert(database: sqlite3.Connection, table: str, rows: Iterator[Row]) -> None:
    first = next(rows, None)
    if first is None:
        return
    values = f"INSERT INTO {table} VALUES ({','.join('?' * len(first))})"
    database.execute(values, first)
    database.executemany(values, rows)


def _about(result: Result) -> Iterator[Row]:
    yield "name", result.report.input.name
    # the result does not depend on the threads
    yield "config", result.config.model_dump_json(exclude={"global_slam": {"num_threads"}})
    yield "report", json.dumps(report_without_times(result.report), allow_nan=False)
    yield "program", f"cartoloop {cartoloop.__version__}"


def _submaps(grids: Sequence[FinishedGrid], poses: FloatArray) -> Iterator[Row]:
    for index, (grid, pose) in enumerate(zip(grids, poses.tolist(), strict=True)):
        place = (grid.origin_x, grid.origin_y, grid.resolution)
        yield index, *pose, *grid.shape, *place, grid.packed


def _nodes(result: Result) -> Iterator[Row]:
    nothing = np.zeros((0, 2))
    for index, scan, *pose in _rows(result.node_scan_index, *result.graph.node_poses.T):
        points = result.node_points[index] if index < len(result.node_points) else nothing
        yield index, scan, *pose, len(points), *pack_points(points)


def _constraints(graph: PoseGraph, rejected: Closures) -> Iterator[Row]:
    out_of_graph = (
        np.full(len(rejected), REJECTED),
        rejected["submap"],
        rejected["node"],
        *rejected["tf_submap_node"].T,
        *rejected["information"][:, *_UPPER].T,
        rejected["score"],
        rejected["runner_up"],
    )
    in_graph = (
        graph.kinds,
        graph.index_a,
        graph.index_b,
        *graph.relative_poses.T,
        *graph.informations[:, *_UPPER].T,
        graph.scores,
        graph.runner_ups,
    )
    rows = chain(_rows(*in_graph), _rows(*out_of_graph, first=graph.num_constraints))
    for *row, score, runner_up in rows:
        yield *row, _or_null(score), _or_null(runner_up)


def _trajectory(result: Result) -> Iterator[Row]:
    return _rows(result.stamps, *result.trajectory.T, *result.local_trajectory.T)


def _rows(*columns: NDArray[Any], first: int = 0) -> Iterator[Row]:
    """Yield the rows of a table, each with its number, from `first` on.

    They are made some at a time: whoever waits for the interpreter does not wait for all.
    """
    for done in range(0, len(columns[0]), _ROWS_AT_A_TIME):
        some = (column[done : done + _ROWS_AT_A_TIME].tolist() for column in columns)
        yield from zip(count(first + done), *some, strict=False)


def _or_null(value: float) -> float | None:
    return None if math.isnan(value) else value
