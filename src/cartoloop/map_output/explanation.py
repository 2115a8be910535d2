# SPDX-License-Identifier: Apache-2.0
"""Explains in sentences why a pair of submap and node is a loop closure, or why not."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cartoloop.errors import InputError
from cartoloop.global_slam.closure_residuals import residuals, weights
from cartoloop.global_slam.closure_search import mean_score
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.pair_selection import PairSelection
from cartoloop.global_slam.pair_verdict import PairVerdict, WhyNot
from cartoloop.global_slam.pose_graph import (
    ConstraintKind,
)
from cartoloop.global_slam.sessions import NodeSubmaps
from cartoloop.map_data import MapData
from cartoloop.map_output.closure_sentences import (
    REQUESTS_NOT_RECORDED,
    Sentences,
    why_not_requested,
)
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.session import session_numbers

NEAR_M = 1.0
"""Nodes this close to a position are considered by :meth:`Explainer.near` [m]."""

NOTHING_MAPPED = "the map has no nodes: nothing was mapped"
"""Said of a map without nodes."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """The explanation of one pair.

    Attributes
    ----------
    submap, node : the pair.
    closure : its row in the record, None if it was never requested nor matched.
    status, reason : words of :class:`Status` and :class:`Reason`; for a pair without a row
        "not_requested" and why, in words; "unknown" if the map file holds no requests.
    values : numbers behind the sentences, by the names of the columns of ``closures.csv``.
    sentences : what happened to it, in order.
    """

    submap: int
    node: int
    closure: int | None
    status: str
    reason: str
    values: dict[str, float]
    sentences: tuple[str, ...]

    @property
    def text(self) -> str:
        """The explanation as a paragraph under a heading."""
        name = "" if self.closure is None else f"Closure {self.closure}: "
        heading = f"{name}submap {self.submap}, node {self.node}: {self.status.replace('_', ' ')}"
        return "\n".join((heading, *(f"  {sentence}" for sentence in self.sentences)))

    def to_dict(self) -> dict[str, Any]:
        """Return plain dictionaries, lists and numbers, as for JSON."""
        return asdict(self)


class Explainer:
    """Explains the closures of a map, finished or growing.

    Parameters
    ----------
    result : the map.
    """

    def __init__(self, result: MapData) -> None:
        self._result = result
        self._closures = result.closures
        self._sentences = Sentences(
            result.config.global_slam, result.closures, self._own_score_between_sessions
        )
        self._selection: PairSelection | None = None
        # A map file of version 2 has no requests, but its report counts the searches.
        searched = result.report.constraints.searched
        self._has_requests = result.closures.num_searched >= searched

    def row(self, closure: int) -> Explanation:
        """Return what happened to a row of the record.

        Raises
        ------
        InputError
            There is no such row.
        """
        if not 0 <= closure < len(self._closures):
            raise InputError(
                f"closure {closure}: the record has {len(self._closures)} rows, counted from 0; "
                "they are those of closures.csv"
            )
        record = self._closures
        values = self._values(closure)
        status = Status(int(record.status[closure]))
        reason = Reason(int(record.reason[closure]))
        if not self._has_requests:
            requested = [REQUESTS_NOT_RECORDED]
        elif record.search_status[closure] != Status.NOT_REQUESTED:
            requested = self._sentences.of_request(closure, values)
        else:
            verdict = self._verdict(int(record.submap[closure]), int(record.node[closure]))
            requested = [why_not_requested(verdict)]
        sentences = (*requested, *self._sentences.after_request(closure, values))
        return Explanation(
            int(record.submap[closure]),
            int(record.node[closure]),
            closure,
            status.text,
            reason.text,
            values,
            sentences,
        )

    def pair(self, submap: int, node: int) -> Explanation:
        """Return what happened to a pair, or why it was never requested.

        Raises
        ------
        InputError
            There is no such submap or node.
        """
        graph = self._result.graph
        if graph.num_nodes == 0:
            raise InputError(NOTHING_MAPPED)
        if not (0 <= submap < graph.num_submaps and 0 <= node < graph.num_nodes):
            raise InputError(
                f"submap {submap}, node {node}: the map has submaps 0 to {graph.num_submaps - 1} "
                f"and nodes 0 to {graph.num_nodes - 1}"
            )
        row = self._closures.find(submap, node)
        if row is not None:
            return self.row(row)
        verdict = self._verdict(submap, node)
        if not self._has_requests and verdict.why_not is not WhyNot.OWN_SUBMAP:
            return self._unknown(submap, node, verdict)
        why = "" if verdict.why_not is None else verdict.why_not.value
        return Explanation(
            submap,
            node,
            None,
            Status.NOT_REQUESTED.text,
            why,
            {"distance_m": verdict.distance, "path_length_m": verdict.path_length},
            (why_not_requested(verdict),),
        )

    @staticmethod
    def _unknown(submap: int, node: int, verdict: PairVerdict) -> Explanation:
        return Explanation(
            submap,
            node,
            None,
            "unknown",
            "requests are not recorded",
            {"distance_m": verdict.distance, "path_length_m": verdict.path_length},
            (REQUESTS_NOT_RECORDED,),
        )

    def near(self, x: float, y: float, limit: int = 10) -> list[Explanation]:
        """Return the pairs of the nodes near a position [m], map frame, nearest nodes first.

        Of pairs never requested, that of the nearest node and the nearest submap that it was not
        inserted into.

        Raises
        ------
        InputError
            The map has no nodes, or the position is not finite.
        """
        if not (math.isfinite(x) and math.isfinite(y)):
            raise InputError(f"position {x:g} {y:g}: give two finite numbers")
        graph = self._result.graph
        if graph.num_nodes == 0:
            raise InputError(NOTHING_MAPPED)
        distance = np.hypot(*(graph.node_poses[:, :2] - (x, y)).T)
        nearest = int(np.argmin(distance))
        of_rows = distance[self._closures.node]
        rows = np.flatnonzero(of_rows <= max(NEAR_M, distance[nearest]))
        rows = rows[np.argsort(of_rows[rows], kind="stable")][:limit]
        found = [self.row(row) for row in rows.tolist()]
        if not any(one.node == nearest for one in found):
            submap = self._nearest_other_submap(nearest)
            if submap is not None:
                found.insert(0, self.pair(submap, nearest))
        return found[:limit]

    def _nearest_other_submap(self, node: int) -> int | None:
        graph = self._result.graph
        own = (graph.kinds == ConstraintKind.INTRA_SUBMAP) & (graph.index_b == node)
        others = np.setdiff1d(np.arange(graph.num_submaps), graph.index_a[own])
        if len(others) == 0:
            return None
        apart = graph.submap_poses[others, :2] - graph.node_poses[node, :2]
        return int(others[np.argmin(np.hypot(apart[:, 0], apart[:, 1]))])

    def _values(self, row: int) -> dict[str, float]:
        """Return the numbers of one row that exist."""
        record, graph = self._closures, self._result.graph
        values = {
            "score": float(record.score[row]),
            "runner_up": float(record.runner_up[row]),
            "residual": float(record.residual[row]),
            "moved_m": float(record.moved[row, 0]),
            "moved_deg": math.degrees(record.moved[row, 1]),
        }
        if row < record.num_requested and self._has_requests:
            values |= {
                "found_at": float(record.found_at[row]),
                "requested_at": float(record.requested_at[row]),
                "window_m": float(record.linear_window[row]),
                "window_deg": math.degrees(record.angular_window[row]),
                "min_score": float(record.min_score[row]),
            }
        measured = record.measured
        if place := np.flatnonzero(measured.row == row).tolist():
            one = measured.take(np.array(place))
            poses = graph.submap_poses, graph.node_poses
            metres, radians = residuals(one, *poses)
            [weight] = weights(one, *poses, self._result.config.global_slam.pose_adjustment)
            x, y, theta = one.tf_submap_node[0].tolist()
            values |= {"x": x, "y": y, "theta": theta, "weight": float(weight)}
            values["residual_m"] = float(metres[0])
            values["residual_deg"] = math.degrees(radians[0])
        return {name: value for name, value in values.items() if math.isfinite(value)}

    def _own_score_between_sessions(self, row: int) -> float | None:
        """Return how well the scans of a row's submap fit in it; None within one session."""
        result, graph = self._result, self._result.graph
        submap, node = int(self._closures.submap[row]), int(self._closures.node[row])
        sessions = result.sessions
        of_submap = session_numbers([each.first_submap for each in sessions], graph.num_submaps)
        of_node = session_numbers([each.first_node for each in sessions], graph.num_nodes)
        if of_submap[submap] == of_node[node]:
            return None
        own = np.flatnonzero(
            (graph.index_a == submap) & (graph.kinds == ConstraintKind.INTRA_SUBMAP)
        )
        points = [result.node_points[each] for each in graph.index_b[own].tolist()]
        grid = result.submap_grids[submap]
        return mean_score(grid, ScanPoints.of(points), graph.relative_poses[own])

    def _verdict(self, submap: int, node: int) -> PairVerdict:
        if self._selection is None:
            self._selection = selection_of(self._result)
        return self._selection.verdict(self._result.graph, submap, node)


def selection_of(result: MapData) -> PairSelection:
    """Return the pair selection in its state after all nodes and closures of a map."""
    graph = result.graph
    selection = PairSelection(result.config.global_slam.constraint_search)
    submaps = NodeSubmaps.of(graph)
    begins = {session.first_node for session in result.sessions[1:]}
    positions = result.local_trajectory[result.node_scan_index, :2]
    for node, position in enumerate(positions.tolist()):
        num_points = len(result.node_points[node]) if node < len(result.node_points) else 0
        if node in begins:
            selection.begin_session()
        own = (int(submaps.first[node]), int(submaps.last[node]))
        selection.add(tuple(position), num_points, own)
    selection.note_requested(result.closures)
    closures = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    selection.note_adjusted(graph, closures)
    return selection
