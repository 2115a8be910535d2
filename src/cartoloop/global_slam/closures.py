# SPDX-License-Identifier: Apache-2.0
"""The record of all loop closures (section V-B): one row per pair, from its request to its fate.

The searches while mapping request pairs of a finished submap and a node; the last pass matches
pairs again, and pairs that were never searched. The constraints of the pose graph, the counts of
the report, ``closures.csv`` and the table of the map file are views of this record.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartoloop.arrays import CodeArray, FloatArray, IntArray, RowArray
from cartoloop.global_slam.closure_columns import ClosureColumns
from cartoloop.global_slam.closure_matches import (
    FinalMatches,
    MatchTable,
    Requests,
    SearchMatches,
)
from cartoloop.global_slam.closure_status import (
    REASON_OF_SEARCH,
    STATUS_OF_REASON,
    Reason,
    Status,
)

_NO_MATCH = -1
"""Number of a match where a row has none."""

_NO_REASON = int(Reason.NONE)


class Closures(ClosureColumns):
    """All pairs of submap and node that were ever requested, searched or matched."""

    def summary(self) -> dict[str, int]:
        """Return the number of dropped searches, for the report; empty if none."""
        return {"searches_dropped": self.num_dropped} if self.num_dropped else {}

    @property
    def is_repaired(self) -> bool:
        """Whether a closure makes visits agree that contradicted each other."""
        return bool(np.any(self.reason == Reason.REPAIR))

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

    def request_again(self, rows: RowArray, requests: Requests) -> None:
        """Note that pairs will be searched again, in other windows; what was found is kept."""
        self.predicted[rows] = requests.tf_submap_node
        self.linear_window[rows] = requests.linear_window
        self.angular_window[rows] = requests.angular_window

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

    def note_ambiguous(self, rows: RowArray) -> None:
        """Note that requests were matched, but another place in the window fits as well."""
        self._set_search_status(rows, Status.NOT_FOUND, Reason.AMBIGUOUS)

    def note_hypotheses(self, rows: RowArray) -> None:
        """Note that wide searches found matches that are not believed yet."""
        self._set_search_status(rows, Status.HYPOTHESIS, Reason.UNSUPPORTED)

    def add_found(self, matches: SearchMatches, num_nodes: int) -> None:
        """Note what searches found, in the order in which it joins the graph of `num_nodes`."""
        self._set_search_status(matches.row, Status.FOUND, Reason.REACHED_THRESHOLD)
        numbers = self._matches.add(matches)
        self._matches.add_scores(matches, num_nodes)
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
        self.status[found], self.reason[found] = STATUS_OF_REASON[not_matched], not_matched
        keys = self._keys(self.submap, self.node)
        order = np.argsort(keys, kind="stable")
        keys = keys[order]
        return [self._note_pass(matches, keys, order) for matches in passes]

    def note_contradicted(self, rows: NDArray[np.integer]) -> None:
        """Note that closures were removed from the graph, because the others contradict them."""
        self.status[rows], self.reason[rows] = Status.CONTRADICTED, Reason.DISAGREES

    def note_removed(self, rows: NDArray[np.integer]) -> None:
        """Note that an edit removed closures from the graph."""
        self.status[rows], self.reason[rows] = Status.REMOVED, Reason.EDIT

    def note_added(self, match: FinalMatches) -> int:
        """Note a closure that was added to the finished map, and return its row.

        Parameters
        ----------
        match : one, with the reason EDIT or REPAIR. It replaces what the last pass measured for
            its pair.
        """
        row = self.find(int(match.submap[0]), int(match.node[0]))
        number = _NO_MATCH if row is None else int(self._final_match[row])
        if row is None or number == _NO_MATCH:
            keys = self._keys(self.submap, self.node)
            order = np.argsort(keys, kind="stable")
            return int(self._note_pass(match, keys[order], order)[0])
        self._matches.replace(number, match)
        reason = int(match.reason[0])
        self.status[row], self.reason[row] = STATUS_OF_REASON[reason], reason
        return row

    def note_repaired(self, matches: FinalMatches) -> IntArray:
        """Note closures that make visits agree, with the reason REPAIR; return their rows."""
        rows = [
            self.note_added(FinalMatches._make(column[[index]] for column in matches))
            for index in range(len(matches.node))
        ]
        return np.array(rows, dtype=np.int64)

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
        closures._matches.restore(matches)
        numbers, num_found = np.arange(len(matches.row)), len(matches.score)
        closures._found_match[matches.row[:num_found]] = numbers[:num_found]
        closures._final_match[matches.row[num_found:]] = numbers[num_found:]
        return closures

    def copy(self) -> Closures:
        """Return a copy that does not change when this record does."""
        copied = Closures()
        copied._rows.extend(self._rows.view)
        copied._requests.extend(self._requests.view)
        copied._matches.restore(self.match_table)
        return copied

    def _add_rows(self, submap: ArrayLike, node: NDArray[Any], status: Status) -> None:
        # Column by column: to write tuples into a structured array takes longer.
        rows, code = self._rows.grow(len(node)), int(status)
        rows["submap"], rows["node"] = submap, node
        rows["found_match"] = rows["final_match"] = _NO_MATCH
        rows["status"] = rows["search_status"] = code
        rows["reason"] = _NO_REASON

    def _add_requests(self, requests: Requests, requested_at: ArrayLike) -> None:
        rows = self._requests.grow(len(requests.submap))
        rows["node_submap"] = requests.node_submap
        rows["requested_at"] = requested_at
        rows["predicted"] = requests.tf_submap_node
        rows["linear_window"] = requests.linear_window
        rows["angular_window"] = requests.angular_window
        rows["min_score"] = np.nan

    def _set_search_status(self, rows: RowArray, status: Status, reason: Reason) -> None:
        self.status[rows] = self.search_status[rows] = status
        self.reason[rows] = reason

    def _forget_last_pass(self) -> None:
        self._rows.shorten(self.num_requested)
        self._matches.forget_last_pass()
        self._final_match[:] = _NO_MATCH
        is_final = (self.status >= Status.REPLACED) & (self.status <= Status.CONTRADICTED)
        self.status[is_final] = self.search_status[is_final]
        # The reasons of a search follow from its status, but for requests that were not searched.
        self.reason[is_final] = REASON_OF_SEARCH[self.search_status[is_final]]

    def _note_pass(self, matches: FinalMatches, keys: IntArray, order: IntArray) -> IntArray:
        """Add matches, given the sorted keys of the requests and their rows."""
        wanted = self._keys(matches.submap, matches.node)
        place = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
        is_new = keys[place] != wanted if len(keys) else np.ones(len(wanted), dtype=bool)
        rows = np.empty(len(wanted), dtype=np.int64)
        rows[~is_new] = order[place[~is_new]]
        rows[is_new] = np.arange(np.count_nonzero(is_new)) + len(self)
        self._add_rows(matches.submap[is_new], matches.node[is_new], Status.NOT_REQUESTED)
        self.status[rows] = STATUS_OF_REASON[matches.reason]
        self.reason[rows] = matches.reason
        self._final_match[rows] = self._matches.add(matches)
        return rows
