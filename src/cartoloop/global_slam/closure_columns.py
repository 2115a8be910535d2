# SPDX-License-Identifier: Apache-2.0
"""The columns of the record of closures, and what is read from them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, CodeArray, FloatArray, IntArray, RowArray
from cartoloop.global_slam.closure_matches import MatchColumns, Matched, MatchTable, Requests
from cartoloop.global_slam.closure_status import Status
from cartoloop.growing_array import GrowingArray

_SYMMETRIC = np.array(((0, 1, 2), (1, 3, 4), (2, 4, 5)))


_ROW = np.dtype(
    [
        ("submap", np.int32),
        ("node", np.int32),
        ("found_match", np.int32),
        ("final_match", np.int32),
        ("status", np.int8),
        ("reason", np.int8),
        ("search_status", np.int8),
    ]
)
"""A row of the record. One structured array, because most requests come one at a time, and to
append to seven arrays takes longer than to select the pairs."""

_REQUEST = np.dtype(
    [
        ("node_submap", np.int32),
        ("requested_at", np.int32),
        ("predicted", np.float64, (3,)),
        ("linear_window", np.float64),
        ("angular_window", np.float64),
        ("min_score", np.float64),
    ]
)
"""What a row holds if it was requested while mapping."""


class ClosureColumns:
    """One row per pair of submap and node; :class:`Closures` writes them.

    Rows 0 to `num_requested` - 1 are the requests in their order. Rows of pairs that only the last
    pass matched follow. Columns are views, valid until the next row is added; read only.
    """

    def __init__(self) -> None:
        self._rows = GrowingArray((), _ROW)
        self._requests = GrowingArray((), _REQUEST)
        self._matches = MatchColumns()

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def num_requested(self) -> int:
        """Number of pairs that were requested while mapping."""
        return len(self._requests)

    @property
    def num_found(self) -> int:
        """Number of closures that searches found."""
        return self._matches.num_found

    @property
    def num_searched(self) -> int:
        """Number of pairs that were searched."""
        return int(np.count_nonzero(self.was_searched))

    @property
    def num_dropped(self) -> int:
        """Number of requests that were dropped because too many were waiting."""
        return int(np.count_nonzero(self.search_status == Status.DROPPED))

    @property
    def submap(self) -> RowArray:
        """Index of the submap."""
        return self._row_column("submap")

    @property
    def node(self) -> RowArray:
        """Index of the node."""
        return self._row_column("node")

    @property
    def status(self) -> CodeArray:
        """:class:`Status` of each pair."""
        return self._row_column("status")

    @property
    def reason(self) -> CodeArray:
        """:class:`Reason` of each pair."""
        return self._row_column("reason")

    @property
    def search_status(self) -> CodeArray:
        """:class:`Status` after the search while mapping."""
        return self._row_column("search_status")

    @property
    def was_searched(self) -> BoolArray:
        """Whether each pair was searched while mapping."""
        return np.isin(self.search_status, (Status.NOT_FOUND, Status.HYPOTHESIS, Status.FOUND))

    @property
    def node_submap(self) -> RowArray:
        """The older submap that the node was inserted into; requests only."""
        return self._request_column("node_submap")

    @property
    def predicted(self) -> FloatArray:
        """Predicted tf_submap_node, shape (num_requested, 3) [m, m, rad]."""
        return self._request_column("predicted")

    @property
    def linear_window(self) -> FloatArray:
        """Search window radius [m]; requests only."""
        return self._request_column("linear_window")

    @property
    def angular_window(self) -> FloatArray:
        """Search window radius [rad]; requests only."""
        return self._request_column("angular_window")

    @property
    def min_score(self) -> FloatArray:
        """Threshold that was applied, NaN where not searched; requests only."""
        return self._request_column("min_score")

    @property
    def requested_at(self) -> RowArray:
        """Number of nodes when the pair was requested; requests only."""
        return self._request_column("requested_at")

    @property
    def score(self) -> FloatArray:
        """Match score of the search, shape (len(self),); NaN where not found."""
        return self._spread(self._found_match, self._matches.scores.view)

    @property
    def runner_up(self) -> FloatArray:
        """Best score elsewhere in the window, shape (len(self),); NaN where not found."""
        return self._spread(self._found_match, self._matches.runner_ups.view)

    @property
    def found_at(self) -> FloatArray:
        """Number of nodes when the closure joined the graph, shape (len(self),); NaN: never."""
        return self._spread(self._found_match, self._matches.joined_at.view)

    @property
    def residual(self) -> FloatArray:
        """Fit residual of the newest measurement, shape (len(self),); NaN without one."""
        return self._spread(self._newest_match, self._matches.residuals.view)

    @property
    def moved(self) -> FloatArray:
        """How far the newest refinement moved, shape (len(self), 2) [m, rad]; NaN without one."""
        return self._spread(self._newest_match, self._matches.moves.view)

    @property
    def has_final_match(self) -> BoolArray:
        """Whether the last pass measured each pair, shape (len(self),)."""
        has_match: BoolArray = self._final_match >= 0
        return has_match

    @property
    def found(self) -> Matched:
        """What searches found, as they measured it, in the order in which it joined the graph."""
        order = np.arange(self.num_found)
        rows = np.flatnonzero(self._found_match >= 0)
        by_match = np.empty(self.num_found, dtype=np.int64)
        by_match[self._found_match[rows]] = rows
        return self._matched(by_match, order)

    @property
    def match_table(self) -> MatchTable:
        """All measurements, as they are stored."""
        rows = np.empty(len(self._matches), dtype=np.int64)
        for column in (self._found_match, self._final_match):
            has_match = np.flatnonzero(column >= 0)
            rows[column[has_match]] = has_match
        return self._matches.table(rows)

    @property
    def measured(self) -> Matched:
        """All rows with a measured pose: that of the last pass, or else that of the search."""
        rows = np.flatnonzero(self._newest_match >= 0)
        return self._matched(rows, self._newest_match[rows])

    def with_status(self, *statuses: Status) -> Matched:
        """Return the rows of these statuses that have a measured pose, with their newest one."""
        chosen = np.isin(self.status, statuses) & (self._newest_match >= 0)
        rows = np.flatnonzero(chosen)
        return self._matched(rows, self._newest_match[rows])

    def requests(self, rows: RowArray) -> Requests:
        """Return what was requested in these rows, shape (n,)."""
        return Requests(
            self.submap[rows],
            self.node[rows],
            self.node_submap[rows],
            self.predicted[rows],
            self.linear_window[rows],
            self.angular_window[rows],
        )

    def num_nodes_to_join(self) -> IntArray:
        """Return how many nodes were added from request to joining, of :attr:`found`."""
        since: IntArray = self._matches.joined_at.view - self.requested_at[self.found.row].astype(
            np.int64
        )
        return since

    def find(self, submap: int, node: int) -> int | None:
        """Return the row of a pair, None if it was never requested nor matched."""
        rows = np.flatnonzero((self.submap == submap) & (self.node == node))
        return int(rows[0]) if len(rows) else None

    def has_rows(self, submap: RowArray, node: RowArray) -> BoolArray:
        """Return which of n pairs have a row, shape (n,)."""
        return np.isin(self._keys(submap, node), self._keys(self.submap, self.node))

    def counts(self) -> dict[Status, int]:
        """Return how many rows have each status."""
        numbers = np.bincount(self.status, minlength=len(Status)).tolist()
        return {status: numbers[status] for status in Status}

    def stored(self) -> dict[str, NDArray[Any]]:
        """Return all columns as they are stored, by name."""
        stored = {name: self._row_column(name) for name in _ROW.names or ()}
        stored |= {name: self._request_column(name) for name in _REQUEST.names or ()}
        return stored | {name: column.view for name, column in vars(self._matches).items()}

    @staticmethod
    def _keys(submap: NDArray[Any], node: NDArray[Any]) -> IntArray:
        keys: IntArray = submap.astype(np.int64) << 32 | node.astype(np.int64)
        return keys

    def _row_column(self, name: str) -> NDArray[Any]:
        column: NDArray[Any] = self._rows.view[name]
        return column

    def _request_column(self, name: str) -> NDArray[Any]:
        column: NDArray[Any] = self._requests.view[name]
        return column

    @property
    def _found_match(self) -> RowArray:
        return self._row_column("found_match")

    @property
    def _final_match(self) -> RowArray:
        return self._row_column("final_match")

    @property
    def _newest_match(self) -> RowArray:
        final = self._final_match
        newest: RowArray = np.where(final >= 0, final, self._found_match)
        return newest

    @staticmethod
    def _spread(match: RowArray, values: NDArray[Any]) -> FloatArray:
        """Return a column of matches as one of rows; NaN where there is no match."""
        column = np.full((len(match), *values.shape[1:]), np.nan)
        has_match = match >= 0
        column[has_match] = values[match[has_match]]
        return column

    def _matched(self, rows: IntArray, matches: NDArray[Any]) -> Matched:
        found = self._found_match[rows]
        return Matched(
            rows,
            self.submap[rows],
            self.node[rows],
            self._matches.poses.view[matches],
            self._matches.informations.view[matches][:, _SYMMETRIC],
            self._matches.residuals.view[matches],
            self._spread(found, self._matches.scores.view),
            self._spread(found, self._matches.runner_ups.view),
        )
