# SPDX-License-Identifier: Apache-2.0
"""The record of all loop closures (section V-B): one row per pair, from its request to its fate.

The searches while mapping request pairs of a finished submap and a node; the last pass matches
pairs again, and pairs that were never searched. The constraints of the pose graph, the counts of
the report, ``closures.csv`` and the table of the map file are views of this record.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartoloop.growing_array import GrowingArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
RowArray = NDArray[np.int32]
CodeArray = NDArray[np.int8]

UPPER = np.triu_indices(3)
"""Entries of an information matrix that are stored: the upper triangle, row by row."""

_SYMMETRIC = np.array(((0, 1, 2), (1, 3, 4), (2, 4, 5)))
_NO_MATCH = -1
"""Number of a match where a row has none."""

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


class Status(IntEnum):
    """What became of a pair. The numbers are part of the file format: append only."""

    NOT_REQUESTED = 0
    """Never requested while mapping; only the last pass matched it."""
    WAITING = 1
    """Requested, not searched yet."""
    DROPPED = 2
    """Not searched: too many searches were waiting (live mapping only)."""
    NOT_SEARCHED = 3
    """Not searched: enough closures between the two submaps had been found before its turn."""
    NOT_FOUND = 4
    """Searched; no candidate reached the threshold."""
    FOUND = 5
    """Found by the search, and a constraint of the graph."""
    REPLACED = 6
    """Found while mapping; the last pass matched other pairs instead."""
    FINAL = 7
    """A constraint of the finished graph, measured by the last pass."""
    POOR_FIT = 8
    """Matched by the last pass; the residual was too large."""
    MOVED_TOO_FAR = 9
    """Matched by the last pass; the match was too far from the adjusted pose."""
    CONTRADICTED = 10
    """Removed from the graph after the last adjustment: the other constraints contradict it."""

    @property
    def text(self) -> str:
        """The name as it stands in files: lower case with underscores."""
        return self.name.lower()


class Reason(IntEnum):
    """Why a pair has its status. The numbers are part of the file format: append only."""

    NONE = 0
    """The status says all."""
    BACKLOG_FULL = 1
    """DROPPED: more searches were waiting than the limit."""
    ENOUGH_CLOSURES = 2
    """NOT_SEARCHED: ``max_closures_of_pair`` closures had been found."""
    EMPTY_SUBMAP = 3
    """NOT_SEARCHED: the submap's grid has no cells."""
    BELOW_THRESHOLD = 4
    """NOT_FOUND: no candidate in the window reached the minimum score."""
    REACHED_THRESHOLD = 5
    """FOUND: the best candidate reached the minimum score."""
    FITS = 6
    """FINAL: residual and shift of the last match are within their limits."""
    EVERY_NTH_NODE = 7
    """REPLACED: the last pass matches one in ``final_every_nth_node`` nodes, not this one."""
    NO_OVERLAP = 8
    """REPLACED: at the adjusted poses, the node is outside the submap's grid."""
    NEARER_SUBMAPS = 9
    """REPLACED: ``final_max_submaps_of_node`` other submaps were nearer to the node."""
    START_RESIDUAL = 10
    """POOR_FIT: residual at the adjusted pose above ``max_start_residual``; not matched again."""
    RESIDUAL = 11
    """POOR_FIT: residual of the match above ``max_refined_residual``."""
    TRANSLATION = 12
    """MOVED_TOO_FAR: shifted by more than ``max_refinement``."""
    ROTATION = 13
    """MOVED_TOO_FAR: rotated by more than ``max_refinement`` allows."""
    DISAGREES = 14
    """CONTRADICTED: residual after adjustment above 0.2 m or 1 degree (table IV)."""

    @property
    def text(self) -> str:
        """The name as it stands in files; empty for NONE."""
        return self.name.lower() if self else ""


STATUS_OF_REASON = {
    Reason.EVERY_NTH_NODE: Status.REPLACED,
    Reason.NO_OVERLAP: Status.REPLACED,
    Reason.NEARER_SUBMAPS: Status.REPLACED,
    Reason.FITS: Status.FINAL,
    Reason.START_RESIDUAL: Status.POOR_FIT,
    Reason.RESIDUAL: Status.POOR_FIT,
    Reason.TRANSLATION: Status.MOVED_TOO_FAR,
    Reason.ROTATION: Status.MOVED_TOO_FAR,
}
"""What the last pass leads to."""


class Requests(NamedTuple):
    """Pairs to be searched.

    Attributes
    ----------
    submap, node : int32, shape (n,), indices in the pose graph.
    node_submap : int32, shape (n,), the older submap that the node was inserted into.
    tf_submap_node : float64, shape (n, 3), predicted, the centre of the window [m, m, rad].
    linear_window, angular_window : float64, shape (n,), search window radii [m], [rad].
    """

    submap: RowArray
    node: RowArray
    node_submap: RowArray
    tf_submap_node: FloatArray
    linear_window: FloatArray
    angular_window: FloatArray

    def take(self, which: IntArray | slice) -> Requests:
        """Return some of them, by index or slice."""
        return Requests._make(column[which] for column in self)


class SearchMatches(NamedTuple):
    """Closures that a search found.

    Attributes
    ----------
    row : int32, shape (n,), rows of the record.
    tf_submap_node : float64, shape (n, 3), as measured [m, m, rad].
    information : float64, shape (n, 3, 3), inverse covariance, submap axes.
    residual : float64, shape (n,), root mean square of 1 - M_smooth at the returns.
    score : float64, shape (n,), mean probability at the best candidate, in [0, 1].
    runner_up : float64, shape (n,), best score elsewhere in the window; 0 where none was good
        enough.
    moved_m, moved_rad : float64, shape (n,), from the best candidate to the refined pose.
    """

    row: RowArray
    tf_submap_node: FloatArray
    information: FloatArray
    residual: FloatArray
    score: FloatArray
    runner_up: FloatArray
    moved_m: FloatArray
    moved_rad: FloatArray


class FinalMatches(NamedTuple):
    """Matches of the last pass, accepted or not.

    Attributes
    ----------
    submap, node : int, shape (n,).
    tf_submap_node : float64, shape (n, 3), as measured [m, m, rad].
    information : float64, shape (n, 3, 3), inverse covariance, submap axes.
    residual : float64, shape (n,), as of :class:`SearchMatches`.
    moved_m, moved_rad : float64, shape (n,), from the adjusted pose to the match.
    reason : int8, shape (n,), FITS or why not.
    """

    submap: IntArray
    node: IntArray
    tf_submap_node: FloatArray
    information: FloatArray
    residual: FloatArray
    moved_m: FloatArray
    moved_rad: FloatArray
    reason: CodeArray


class MatchTable(NamedTuple):
    """All measurements: of the searches in joining order, then those of the last pass.

    Attributes
    ----------
    row : int, shape (n,), in the record.
    tf_submap_node : float64, shape (n, 3), as measured [m, m, rad].
    information : float64, shape (n, 6), upper triangle of the inverse covariance, submap axes.
    residual : float64, shape (n,), of the fit.
    moved : float32, shape (n, 2), by the refinement [m, rad].
    score, runner_up, joined_at : shape (num_found,), of the searches.
    """

    row: IntArray
    tf_submap_node: FloatArray
    information: FloatArray
    residual: FloatArray
    moved: NDArray[np.float32]
    score: FloatArray
    runner_up: FloatArray
    joined_at: RowArray


@dataclass(frozen=True, slots=True)
class Matched:
    """Rows that have a measured pose, as arrays.

    Attributes
    ----------
    row : int, shape (n,), in the record.
    submap, node : int32, shape (n,).
    tf_submap_node : float64, shape (n, 3), as measured [m, m, rad].
    information : float64, shape (n, 3, 3), inverse covariance, submap axes.
    residual : float64, shape (n,), fit residual of this measurement.
    score, runner_up : float64, shape (n,), of the search; NaN where the pair was not found by one.
    """

    row: IntArray
    submap: RowArray
    node: RowArray
    tf_submap_node: FloatArray
    information: FloatArray
    residual: FloatArray
    score: FloatArray
    runner_up: FloatArray

    def __len__(self) -> int:
        return len(self.row)

    def take(self, which: IntArray) -> Matched:
        """Return some of them, by index."""
        return Matched(
            self.row[which],
            self.submap[which],
            self.node[which],
            self.tf_submap_node[which],
            self.information[which],
            self.residual[which],
            self.score[which],
            self.runner_up[which],
        )


class Closures:
    """All pairs of submap and node that were ever requested, searched or matched.

    Rows 0 to `num_requested` - 1 are the requests in their order. Rows of pairs that only the last
    pass matched follow. Columns are views, valid until the next row is added; read only.

    Attributes of the columns, shape (len(self),)
    ---------------------------------------------
    submap, node : int32, indices in the pose graph.
    status, reason : int8, :class:`Status`, :class:`Reason`: what became of the pair at last.
    search_status : int8, :class:`Status`: what the search while mapping came to; NOT_REQUESTED
        where the last pass alone matched the pair.

    Only of requests, shape (num_requested,)
    ----------------------------------------
    node_submap : int32, the older submap that the node was inserted into.
    predicted : float64, (num_requested, 3), predicted tf_submap_node, the centre of the window.
    linear_window, angular_window : float64, search window radii [m], [rad].
    min_score : float64, threshold that was applied; NaN where not searched.
    requested_at : int32, number of nodes when the pair was requested.
    """

    def __init__(self) -> None:
        self._rows = GrowingArray((), _ROW)
        self._requests = GrowingArray((), _REQUEST)
        self._poses = GrowingArray((3,), np.float64)
        self._informations = GrowingArray((6,), np.float64)
        self._residuals = GrowingArray((), np.float64)
        self._moves = GrowingArray((2,), np.float32)
        self._scores = GrowingArray((), np.float64)
        self._runner_ups = GrowingArray((), np.float64)
        self._joined_at = GrowingArray((), np.int32)

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def num_requested(self) -> int:
        """Number of pairs that were requested while mapping."""
        return len(self._requests)

    @property
    def num_found(self) -> int:
        """Number of closures that searches found."""
        return len(self._scores)

    @property
    def num_searched(self) -> int:
        """Number of pairs that were searched."""
        return int(np.count_nonzero(self.was_searched))

    @property
    def num_dropped(self) -> int:
        """Number of requests that were dropped because too many were waiting."""
        return int(np.count_nonzero(self.search_status == Status.DROPPED))

    def summary(self) -> dict[str, int]:
        """Return the number of dropped searches, for the report; empty if none."""
        return {"searches_dropped": self.num_dropped} if self.num_dropped else {}

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
    def was_searched(self) -> NDArray[np.bool_]:
        """Whether each pair was searched while mapping."""
        searched: NDArray[np.bool_] = (self.search_status == Status.NOT_FOUND) | (
            self.search_status == Status.FOUND
        )
        return searched

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
        return self._spread(self._found_match, self._scores.view)

    @property
    def runner_up(self) -> FloatArray:
        """Best score elsewhere in the window, shape (len(self),); NaN where not found."""
        return self._spread(self._found_match, self._runner_ups.view)

    @property
    def found_at(self) -> FloatArray:
        """Number of nodes when the closure joined the graph, shape (len(self),); NaN: never."""
        return self._spread(self._found_match, self._joined_at.view)

    @property
    def residual(self) -> FloatArray:
        """Fit residual of the newest measurement, shape (len(self),); NaN without one."""
        return self._spread(self._newest_match, self._residuals.view)

    @property
    def moved(self) -> FloatArray:
        """How far the newest refinement moved, shape (len(self), 2) [m, rad]; NaN without one."""
        return self._spread(self._newest_match, self._moves.view)

    @property
    def has_final_match(self) -> NDArray[np.bool_]:
        """Whether the last pass measured each pair, shape (len(self),)."""
        has_match: NDArray[np.bool_] = self._final_match >= 0
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
        rows = np.empty(len(self._poses), dtype=np.int64)
        for column in (self._found_match, self._final_match):
            has_match = np.flatnonzero(column >= 0)
            rows[column[has_match]] = has_match
        return MatchTable(
            rows,
            self._poses.view,
            self._informations.view,
            self._residuals.view,
            self._moves.view,
            self._scores.view,
            self._runner_ups.view,
            self._joined_at.view,
        )

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
        since: IntArray = self._joined_at.view - self.requested_at[self.found.row].astype(np.int64)
        return since

    def find(self, submap: int, node: int) -> int | None:
        """Return the row of a pair, None if it was never requested nor matched."""
        rows = np.flatnonzero((self.submap == submap) & (self.node == node))
        return int(rows[0]) if len(rows) else None

    def counts(self) -> dict[Status, int]:
        """Return how many rows have each status."""
        numbers = np.bincount(self.status, minlength=len(Status)).tolist()
        return {status: numbers[status] for status in Status}

    def request(self, requests: Requests, num_nodes: int) -> RowArray:
        """Add pairs to be searched; return their rows.

        Parameters
        ----------
        requests : pairs that have no row yet.
        num_nodes : of the graph at this moment.
        """
        first = len(self)
        self._add_rows(requests.submap, requests.node, Status.WAITING)
        self._add_requests(requests, num_nodes)
        return np.arange(first, len(self), dtype=np.int32)

    def note_dropped(self, rows: RowArray) -> None:
        """Note that requests will not be searched, because too many are waiting."""
        self._set_search_status(rows, Status.DROPPED, Reason.BACKLOG_FULL)

    def note_not_searched(self, rows: RowArray, reason: Reason) -> None:
        """Note that requests were not searched when it was their turn."""
        self._set_search_status(rows, Status.NOT_SEARCHED, reason)

    def note_searched(self, rows: RowArray, min_score: float | FloatArray) -> None:
        """Note that requests were searched with a threshold, or with one each, shape (n,).

        :meth:`add_found` may follow.
        """
        self._set_search_status(rows, Status.NOT_FOUND, Reason.BELOW_THRESHOLD)
        self.min_score[rows] = min_score

    def add_found(self, matches: SearchMatches, num_nodes: int) -> None:
        """Note what searches found, in the order in which it joins the graph of `num_nodes`."""
        self._set_search_status(matches.row, Status.FOUND, Reason.REACHED_THRESHOLD)
        numbers = self._add_matches(
            matches.tf_submap_node,
            matches.information,
            matches.residual,
            matches.moved_m,
            matches.moved_rad,
        )
        self._scores.extend(matches.score)
        self._runner_ups.extend(matches.runner_up)
        self._joined_at.grow(len(matches.row))[:] = num_nodes
        # Last: the viewer's thread may read the record, and must not find a match without a score.
        self._found_match[matches.row] = numbers

    def note_last_pass(
        self, not_matched: CodeArray, passes: Iterable[FinalMatches]
    ) -> list[IntArray]:
        """Note what a pass over the finished map came to; an earlier pass is forgotten.

        Parameters
        ----------
        not_matched : int8, shape (num_found,), of each closure of :attr:`found` the reason why
            it was not matched again; not used where it was.
        passes : matches; each pair once.

        Returns
        -------
        rows of each of the passes.
        """
        self._forget_last_pass()
        found = self.found.row
        self.status[found], self.reason[found] = _STATUS_OF_REASON[not_matched], not_matched
        keys = self._keys(self.submap, self.node)
        order = np.argsort(keys, kind="stable")
        keys = keys[order]
        return [self._note_pass(matches, keys, order) for matches in passes]

    def note_contradicted(self, rows: NDArray[np.integer]) -> None:
        """Note that closures were removed from the graph, because the others contradict them."""
        self.status[rows], self.reason[rows] = Status.CONTRADICTED, Reason.DISAGREES

    @classmethod
    def restored(
        cls,
        ends: tuple[IntArray, IntArray],
        codes: tuple[IntArray, IntArray, IntArray],
        requests: Requests,
        min_score: FloatArray,
        requested_at: IntArray,
        matches: MatchTable,
    ) -> Closures:
        """Return the record with these columns, as read from a file.

        Parameters
        ----------
        ends : submap and node, shape (n,) each.
        codes : status, reason and search status, shape (n,) each.
        requests : of the first rows; `min_score`, `requested_at` likewise.
        matches : all measurements.

        Raises
        ------
        ValueError
            A code is unknown, or a match belongs to no row.
        """
        closures = cls()
        status, reason, search_status = codes
        for code, kind in ((status, Status), (reason, Reason), (search_status, Status)):
            if np.any((code < 0) | (code >= len(kind))):
                raise ValueError("a closure has an unknown status or reason")
        if np.any((matches.row < 0) | (matches.row >= len(status))):
            raise ValueError("a match belongs to no closure")
        closures._add_rows(*ends, Status.WAITING)
        closures.status[:], closures.reason[:] = status, reason
        closures.search_status[:] = search_status
        closures._add_requests(requests, requested_at)
        closures.min_score[:] = min_score
        closures._poses.extend(matches.tf_submap_node)
        closures._informations.extend(matches.information)
        closures._residuals.extend(matches.residual)
        closures._moves.extend(matches.moved)
        closures._scores.extend(matches.score)
        closures._runner_ups.extend(matches.runner_up)
        closures._joined_at.extend(matches.joined_at)
        numbers, num_found = np.arange(len(matches.row)), len(matches.score)
        closures._found_match[matches.row[:num_found]] = numbers[:num_found]
        closures._final_match[matches.row[num_found:]] = numbers[num_found:]
        return closures

    def copy(self) -> Closures:
        """Return a copy that does not change when this record does."""
        copied = Closures()
        for name, column in vars(self).items():
            getattr(copied, name).extend(column.view)
        return copied

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

    @staticmethod
    def _keys(submap: NDArray[Any], node: NDArray[Any]) -> IntArray:
        keys: IntArray = submap.astype(np.int64) << 32 | node.astype(np.int64)
        return keys

    def _matched(self, rows: IntArray, matches: NDArray[Any]) -> Matched:
        found = self._found_match[rows]
        return Matched(
            rows,
            self.submap[rows],
            self.node[rows],
            self._poses.view[matches],
            self._informations.view[matches][:, _SYMMETRIC],
            self._residuals.view[matches],
            self._spread(found, self._scores.view),
            self._spread(found, self._runner_ups.view),
        )

    def _add_rows(self, submap: ArrayLike, node: NDArray[Any], status: Status) -> None:
        # Column by column: to write tuples into a structured array takes longer.
        rows, code = self._rows.grow(len(node)), int(status)
        rows["submap"], rows["node"] = submap, node
        rows["found_match"] = rows["final_match"] = _NO_MATCH
        rows["status"] = rows["search_status"] = code
        rows["reason"] = int(Reason.NONE)

    def _add_requests(self, requests: Requests, requested_at: ArrayLike) -> None:
        rows = self._requests.grow(len(requests.submap))
        rows["node_submap"] = requests.node_submap
        rows["requested_at"] = requested_at
        rows["predicted"] = requests.tf_submap_node
        rows["linear_window"] = requests.linear_window
        rows["angular_window"] = requests.angular_window
        rows["min_score"] = np.nan

    def _add_matches(
        self,
        poses: FloatArray,
        informations: FloatArray,
        residuals: FloatArray,
        moved_m: FloatArray,
        moved_rad: FloatArray,
    ) -> IntArray:
        first = len(self._poses)
        self._poses.extend(poses)
        self._informations.extend(informations[:, *UPPER])
        self._residuals.extend(residuals)
        self._moves.extend(np.column_stack((moved_m, moved_rad)))
        return np.arange(first, len(self._poses))

    def _set_search_status(self, rows: RowArray, status: Status, reason: Reason) -> None:
        self.status[rows] = self.search_status[rows] = status
        self.reason[rows] = reason

    def _forget_last_pass(self) -> None:
        self._rows.shorten(self.num_requested)
        for column in (self._poses, self._informations, self._residuals, self._moves):
            column.shorten(self.num_found)
        self._final_match[:] = _NO_MATCH
        is_final = self.status >= Status.REPLACED
        self.status[is_final] = self.search_status[is_final]
        # The reasons of a search follow from its status, but for requests that were not searched.
        self.reason[is_final] = _REASON_OF_SEARCH[self.search_status[is_final]]

    def _note_pass(self, matches: FinalMatches, keys: IntArray, order: IntArray) -> IntArray:
        """Add matches, given the sorted keys of the requests and their rows."""
        wanted = self._keys(matches.submap, matches.node)
        place = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
        is_new = keys[place] != wanted if len(keys) else np.ones(len(wanted), dtype=bool)
        rows = np.empty(len(wanted), dtype=np.int64)
        rows[~is_new] = order[place[~is_new]]
        rows[is_new] = np.arange(np.count_nonzero(is_new)) + len(self)
        self._add_rows(matches.submap[is_new], matches.node[is_new], Status.NOT_REQUESTED)
        self.status[rows] = _STATUS_OF_REASON[matches.reason]
        self.reason[rows] = matches.reason
        self._final_match[rows] = self._add_matches(
            matches.tf_submap_node,
            matches.information,
            matches.residual,
            matches.moved_m,
            matches.moved_rad,
        )
        return rows


_REASON_OF_SEARCH = np.zeros(len(Status), dtype=np.int8)
_REASON_OF_SEARCH[Status.DROPPED] = Reason.BACKLOG_FULL
_REASON_OF_SEARCH[Status.NOT_SEARCHED] = Reason.ENOUGH_CLOSURES
_REASON_OF_SEARCH[Status.NOT_FOUND] = Reason.BELOW_THRESHOLD
_REASON_OF_SEARCH[Status.FOUND] = Reason.REACHED_THRESHOLD
_STATUS_OF_REASON = np.zeros(len(Reason), dtype=np.int8)
for _reason, _status in STATUS_OF_REASON.items():
    _STATUS_OF_REASON[_reason] = _status
