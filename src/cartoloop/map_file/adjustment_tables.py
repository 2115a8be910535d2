# SPDX-License-Identifier: Apache-2.0
"""What adjustment has to know of a graph besides poses and constraints, in a map database.

Files of earlier programs have no such tables: in them the first submap is held, and nothing is
trusted.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator

import numpy as np

from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.map_file.tables import indices, numbers_of

MAX_HELD = 10_000
"""Submaps and nodes that are held, at most: pins of users."""


def trusted_rows(graph: PoseGraph) -> Iterator[tuple[int]]:
    """Yield the loop closures that no robust loss weakens, as rows of the record."""
    rows = graph.closure_rows[graph.is_trusted & (graph.closure_rows >= 0)]
    yield from ((row,) for row in np.sort(rows).tolist())


def held_rows(graph: PoseGraph) -> Iterator[tuple[int, int | None, int | None]]:
    """Yield what adjustment does not move; nothing where that is the first submap alone."""
    submaps, nodes = list(graph.fixed_submaps), list(graph.fixed_nodes)
    if submaps == [0] and not nodes:
        return
    both = [(submap, None) for submap in submaps] + [(None, node) for node in nodes]
    yield from ((number, *each) for number, each in enumerate(both))


def read_adjustment_tables(database: sqlite3.Connection, graph: PoseGraph) -> None:
    """Complete a graph that has all poses and constraints.

    Raises
    ------
    ValueError
        A table is damaged.
    """
    if _has_table(database, "trusted"):
        found = database.execute("SELECT closure FROM trusted").fetchall()
        trusted = indices(numbers_of(found, 1)[:, 0], "a trusted closure")
        graph.is_trusted[np.isin(graph.closure_rows, trusted)] = True
    if _has_table(database, "held"):
        rows = database.execute(
            "SELECT submap, node FROM held ORDER BY number LIMIT ?", (MAX_HELD + 1,)
        ).fetchall()
        if len(rows) > MAX_HELD:
            raise ValueError(f"more than {MAX_HELD} submaps and nodes are held")
        if rows:
            held = numbers_of(rows, 2)
            submaps, nodes = (column[~np.isnan(column)] for column in held.T)
            graph.hold_only(
                indices(submaps, "a submap that is held", graph.num_submaps).tolist(),
                indices(nodes, "a node that is held", graph.num_nodes).tolist(),
            )


def _has_table(database: sqlite3.Connection, name: str) -> bool:
    query = "SELECT count(*) FROM sqlite_master WHERE name = ?"
    return bool(database.execute(query, (name,)).fetchone()[0])
