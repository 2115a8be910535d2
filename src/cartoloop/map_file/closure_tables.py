# SPDX-License-Identifier: Apache-2.0
"""The constraints of a graph and the record of closures, read from a map database."""

from __future__ import annotations

import sqlite3

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.global_slam.closure_matches import MatchTable, Requests
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.map_file.tables import finite, indices, numbers_of, symmetric


def constraints_and_closures(database: sqlite3.Connection, graph: PoseGraph) -> Closures:
    """Add the constraints to a graph that has its poses; return the record of closures.

    Raises
    ------
    ValueError, IndexError
        The tables are damaged.
    """
    table = numbers_of(_all(database, "closures"), 15)
    closures = _closures(database, table, graph)
    rows = np.flatnonzero(~np.isnan(table[:, 6]))
    measured = closures.measured
    match = np.searchsorted(measured.row, rows)
    if not np.array_equal(measured.row[np.minimum(match, max(len(measured) - 1, 0))], rows):
        raise ValueError("a closure in the graph has no match")
    others = numbers_of(_all(database, "constraints"), 13)
    finite(others, "a constraint")
    places = np.concatenate((others[:, 0], table[rows, 6]))
    order = np.argsort(places, kind="stable")
    if not np.array_equal(places[order], np.arange(len(order))):
        raise ValueError("constraints are missing")
    kinds = indices(others[:, 1], "the kind of a constraint", len(ConstraintKind))
    if np.any(kinds == ConstraintKind.LOOP_CLOSURE):
        raise ValueError("a loop closure has no row in the record")
    of_closures = np.full(len(rows), int(ConstraintKind.LOOP_CLOSURE))
    graph.add_constraints(
        np.concatenate((kinds, of_closures))[order],
        _joined(indices(others[:, 2], "a submap"), closures.submap[rows], order),
        _joined(indices(others[:, 3], "a node"), closures.node[rows], order),
        np.concatenate((others[:, 4:7], measured.tf_submap_node[match]))[order],
        np.concatenate((symmetric(others[:, 7:13]), measured.information[match]))[order],
        closure_rows=_joined(np.full(len(others), -1), rows, order),
    )
    return closures


def _closures(database: sqlite3.Connection, table: FloatArray, graph: PoseGraph) -> Closures:
    """Return the record, given its rows."""
    if not np.array_equal(table[:, 0], np.arange(len(table))):
        raise ValueError("rows of closures are missing")
    submap = indices(table[:, 1], "the submap of a closure", graph.num_submaps)
    node = indices(table[:, 2], "the node of a closure", graph.num_nodes)
    num_requested = int(np.count_nonzero(~np.isnan(table[:, 7])))
    requested = table[:num_requested]
    finite(requested[:, 7:13], "a request")
    return Closures.restored(
        (submap, node),
        (_codes(table[:, 3]), _codes(table[:, 4]), _codes(table[:, 5])),
        Requests(
            submap[:num_requested].astype(np.int32),
            node[:num_requested].astype(np.int32),
            indices(requested[:, 7], "a submap", graph.num_submaps).astype(np.int32),
            requested[:, 8:11],
            requested[:, 11],
            requested[:, 12],
        ),
        requested[:, 13],
        indices(requested[:, 14], "a number of nodes"),
        _matches(database, len(table)),
    )


def _matches(database: sqlite3.Connection, num_closures: int) -> MatchTable:
    table = numbers_of(_all(database, "matches"), 17)
    finite(table[:, 1:11], "a match")
    num_found = int(np.count_nonzero(~np.isnan(table[:, 14])))
    return MatchTable(
        indices(table[:, 1], "the closure of a match", num_closures),
        table[:, 2:5],
        table[:, 5:11],
        table[:, 11],
        table[:, 12:14].astype(np.float32),
        table[:num_found, 14],
        table[:num_found, 15],
        indices(table[:num_found, 16], "a number of nodes").astype(np.int32),
    )


def _codes(column: FloatArray) -> IntArray:
    return indices(column, "the status or reason of a closure")


def _joined(first: IntArray, second: NDArray[np.integer], order: IntArray) -> IntArray:
    joined: IntArray = np.concatenate((first, second.astype(np.int64)))[order]
    return joined


def _all(database: sqlite3.Connection, table: str) -> list[tuple[object, ...]]:
    rows: list[tuple[object, ...]] = database.execute(
        f"SELECT * FROM {table} ORDER BY 1"
    ).fetchall()
    return rows
