# SPDX-License-Identifier: Apache-2.0
"""Requests for searches of pairs of a node and a submap, and of composite scans."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartoloop.global_slam.closure_matches import Requests
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.constraint_search import ConstraintSearch
from cartoloop.global_slam.pair_selection import PairSelection
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.wide_search import WideSearch, record_requests
from cartoloop.journal.outcomes import RecordedOutcomes
from cartoloop.runtime.stage_timer import StageTimer


class ClosureRequests:
    """Selects pairs and hands them to the searches.

    Parameters
    ----------
    graph : pose graph.
    finished : the finished submaps so far.
    pairs, wide : select pairs of a node and of a composite scan with a submap.
    search : the background search of pairs.
    closures : the record, which gets a row for each request.
    timer : takes the times.
    outcomes : of a run with a journal.
    """

    def __init__(
        self,
        graph: PoseGraph,
        finished: Sequence[FinishedSubmap],
        pairs: PairSelection,
        wide: WideSearch,
        search: ConstraintSearch,
        closures: Closures,
        timer: StageTimer,
        outcomes: RecordedOutcomes,
    ) -> None:
        self._graph = graph
        self._finished = finished
        self._pairs = pairs
        self._wide = wide
        self._search = search
        self._closures = closures
        self._timer = timer
        self._recorded = outcomes

    def of_node(self, node: int) -> None:
        """Request searches for a node in the finished submaps nearby."""
        with self._timer.measure("select pairs"):
            found = self._pairs.of_node(self._graph, node, len(self._finished))
            if self._pairs.was_lost:
                are_new = ~self._closures.has_rows(found.submap, found.node)
                found = found.take(np.flatnonzero(are_new))
            self._submit(found)

    def in_submap(self, submap: FinishedSubmap) -> None:
        """Request searches in a submap that has just been finished, for the nodes nearby."""
        with self._timer.measure("select pairs"):
            self._submit(self._pairs.in_submap(self._graph, submap.index))

    def wide(self, scan: int | None) -> None:
        """Request searches for a composite scan wherever the drift may have placed it."""
        if scan is not None:
            with self._timer.measure("select pairs"):
                self._wide.request(scan, self._pairs, self._graph)

    def again(self) -> None:
        """Request searches for the pairs that are due by now and were not before."""
        with self._timer.measure("select pairs"):
            self._submit(self._pairs.again(self._graph, len(self._finished), self._closures))

    def _submit(self, requests: Requests) -> None:
        if len(requests.submap):
            num_nodes = self._graph.num_nodes
            rows = record_requests(self._recorded, self._closures, requests, num_nodes)
            self._search.submit(rows)
