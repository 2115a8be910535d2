# SPDX-License-Identifier: Apache-2.0
"""The constraints of a graph, read from a map database of version 2, which had no record.

Its closures become rows without a request, but those that a search found and no last pass measured.
"""

from __future__ import annotations

import sqlite3

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.global_slam.closure_matches import FinalMatches, Requests, SearchMatches
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.map_file.tables import finite, indices, numbers_of, symmetric

_REJECTED = 3
"""Kind of a loop closure that had been removed from the graph."""


def constraints_and_closures_v2(database: sqlite3.Connection, graph: PoseGraph) -> Closures:
    """Add the constraints to a graph that has its poses; return the closures among them.

    Raises
    ------
    ValueError, IndexError
        The table is damaged.
    """
    rows = database.execute("SELECT * FROM constraints ORDER BY 1").fetchall()
    table = numbers_of(rows, 15)
    finite(table[:, :13], "a constraint")
    kinds = indices(table[:, 1], "the kind of a constraint", _REJECTED + 1)
    submap_or_node = indices(table[:, 2], "an end of a constraint")
    node = indices(table[:, 3], "an end of a constraint", graph.num_nodes)
    is_closure = (kinds == ConstraintKind.LOOP_CLOSURE) | (kinds == _REJECTED)
    indices(table[is_closure, 2], "the submap of a closure", graph.num_submaps)
    closures = Closures()
    closure_rows = np.full(len(table), -1)
    found = np.flatnonzero(is_closure & ~np.isnan(table[:, 14]))
    if len(found):
        closure_rows[found] = _add_found(closures, table[found], graph.num_nodes)
    again = np.flatnonzero(is_closure & np.isnan(table[:, 14]))
    if len(again):
        closure_rows[again] = _add_final(closures, table[again])
    closures.note_contradicted(closure_rows[kinds == _REJECTED])
    kept = kinds != _REJECTED
    graph.add_constraints(
        kinds[kept],
        submap_or_node[kept],
        node[kept],
        table[kept, 4:7],
        symmetric(table[kept, 7:13]),
        closure_rows=closure_rows[kept],
    )
    return closures


def _add_found(closures: Closures, table: FloatArray, num_nodes: int) -> NDArray[np.int32]:
    """Add closures that a search found; its window was not stored."""
    count = len(table)
    submap, node = table[:, 2].astype(np.int32), table[:, 3].astype(np.int32)
    unknown = np.zeros(count)
    rows = closures.request(
        Requests(submap, node, submap, table[:, 4:7], unknown, unknown), num_nodes
    )
    closures.add_found(
        SearchMatches(
            row=rows,
            tf_submap_node=table[:, 4:7],
            information=symmetric(table[:, 7:13]),
            residual=np.full(count, np.nan),
            score=table[:, 13],
            runner_up=table[:, 14],
            moved_m=unknown,
            moved_rad=unknown,
        ),
        num_nodes,
    )
    return rows


def _add_final(closures: Closures, table: FloatArray) -> NDArray[np.int64]:
    """Add closures that the last pass measured; their score was 1 less the residual."""
    count = len(table)
    matches = FinalMatches(
        submap=table[:, 2].astype(np.int64),
        node=table[:, 3].astype(np.int64),
        tf_submap_node=table[:, 4:7],
        information=symmetric(table[:, 7:13]),
        residual=1.0 - table[:, 13],
        moved_m=np.full(count, np.nan),
        moved_rad=np.full(count, np.nan),
        reason=np.full(count, Reason.FITS, dtype=np.int8),
    )
    replaced = np.full(closures.num_found, Reason.NO_OVERLAP, dtype=np.int8)
    [rows] = closures.note_last_pass(replaced, [matches])
    return rows
