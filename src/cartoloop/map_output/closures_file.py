# SPDX-License-Identifier: Apache-2.0
"""Nodes and the record of closures as CSV files, for tables and plots.

``nodes.csv`` has one row per node, ``closures.csv`` one row per pair of submap and node that was
requested or matched; empty fields are values that do not exist.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.global_slam.closure_residuals import residuals, weights
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.kernels.csv_rows import MAX_DIGITS, write_rows
from cartoloop.map_output.text_files import format_stamp

if TYPE_CHECKING:
    from cartoloop.map_data import MapData


NODE_COLUMNS = ("node", "stamp", "submaps")
"""Index of the node, stamp of its scan [s], indices of its submaps separated by blanks."""


class _Column(NamedTuple):
    name: str
    decimals: int
    meaning: str


_NUMBERS = (
    _Column("submap", 0, "index of the finished submap"),
    _Column("node", 0, "index of the node"),
    _Column("requested_at", 0, "number of nodes when the pair was requested"),
    _Column("found_at", 0, "number of nodes when the closure joined the graph"),
    _Column("window_m", 3, "search window radius [m]"),
    _Column("window_deg", 2, "search window radius [deg]"),
    _Column("min_score", 4, "threshold that was applied"),
    _Column("score", 4, "mean probability at the best candidate"),
    _Column("runner_up", 4, "best score elsewhere in the window, 0: none came near the threshold"),
    _Column("residual", 4, "root mean square of 1 - M at the returns, of the newest match"),
    _Column("moved_m", 4, "shift by the newest match [m]"),
    _Column("moved_deg", 3, "rotation by the newest match [deg]"),
    _Column("x", 6, "newest measurement of tf_submap_node [m]"),
    _Column("y", 6, "the same"),
    _Column("theta", 7, "the same [rad]"),
    _Column("residual_m", 5, "disagreement of the final poses with this measurement [m]"),
    _Column("residual_deg", 4, "the same [deg]"),
    _Column("weight", 4, "factor of the information under the robust loss, in [0, 1]"),
)

CLOSURE_COLUMNS = ("status", "reason", "search", *(column.name for column in _NUMBERS))
"""Columns of ``closures.csv``; `status`, `reason` and `search` (the status after the search while
mapping) are words of :class:`Status` and :class:`Reason`."""


def nodes_csv(result: MapData) -> str:
    """Return which scan each node is and which submaps it was inserted into, one row a node."""
    graph = result.graph
    submaps: list[list[int]] = [[] for _ in range(graph.num_nodes)]
    own = graph.kinds == ConstraintKind.INTRA_SUBMAP
    for submap, node in zip(graph.index_a[own].tolist(), graph.index_b[own].tolist(), strict=True):
        submaps[node].append(submap)
    stamps = result.stamps[result.node_scan_index].tolist()
    lines = [",".join(NODE_COLUMNS)]
    lines += [
        f"{node},{format_stamp(stamp)},{' '.join(map(str, sorted(submaps[node])))}"
        for node, stamp in enumerate(stamps)
    ]
    return "\n".join(lines) + "\n"


def closures_csv(result: MapData) -> bytes:
    """Return the record of closures, one row per pair, in the order of the record."""
    header = f"{','.join(CLOSURE_COLUMNS)}\n".encode()
    closures = result.closures
    words = [word.text for word in (*Status, *Reason)]
    bounds = np.cumsum([0, *(len(word) for word in words)])
    codes = np.column_stack(
        (closures.status, closures.reason.astype(np.int64) + len(Status), closures.search_status)
    ).astype(np.int64)
    longest = 3 * (max(map(len, words)) + 1) + len(_NUMBERS) * (MAX_DIGITS + 1)
    text = np.empty(min(len(closures), _ROWS_AT_A_TIME) * longest, dtype=np.uint8)
    letters = np.frombuffer("".join(words).encode(), dtype=np.uint8)
    decimals = np.array([column.decimals for column in _NUMBERS], dtype=np.int64)
    numbers = _numbers(result)
    parts = [header]
    for first in range(0, len(closures), _ROWS_AT_A_TIME):
        some = slice(first, first + _ROWS_AT_A_TIME)
        rows = np.column_stack([column[some] for column in numbers])
        size = write_rows(letters, bounds, codes[some], rows, decimals, text)
        parts.append(text[:size].tobytes())
    return b"".join(parts)


_ROWS_AT_A_TIME = 4096
"""Rows that are written in one go: bounds the memory."""


def _numbers(result: MapData) -> list[NDArray[np.floating | np.integer]]:
    """Return the columns of :data:`_NUMBERS`, shape (n,) each."""
    closures, graph = result.closures, result.graph
    measured = closures.measured
    metres, radians = residuals(measured, graph.submap_poses, graph.node_poses)
    weight = weights(
        measured, graph.submap_poses, graph.node_poses, result.config.global_slam.pose_adjustment
    )
    of_measured = np.full((len(closures), 6), np.nan)
    of_measured[measured.row] = np.column_stack(
        (measured.tf_submap_node, metres, np.degrees(radians), weight)
    )
    moved = closures.moved
    return [
        closures.submap,
        closures.node,
        _padded(closures.requested_at, closures),
        closures.found_at,
        _padded(closures.linear_window, closures),
        np.degrees(_padded(closures.angular_window, closures)),
        _padded(closures.min_score, closures),
        closures.score,
        closures.runner_up,
        closures.residual,
        moved[:, 0],
        np.degrees(moved[:, 1]),
        *of_measured.T,
    ]


def _padded(column: NDArray[np.floating | np.integer], closures: Closures) -> FloatArray:
    """Return a column of requests as one of all rows."""
    padded = np.full(len(closures), np.nan)
    padded[: len(column)] = column
    return padded
