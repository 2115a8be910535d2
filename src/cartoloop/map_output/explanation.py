# SPDX-License-Identifier: Apache-2.0
"""Why a pair of submap and node is a loop closure, or is not, in plain sentences."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cartoloop.errors import InputError
from cartoloop.global_slam.closure_residuals import residuals, weights
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.pair_selection import PairSelection, PairVerdict
from cartoloop.global_slam.pose_graph import (
    TRUE_ROTATION_RAD,
    TRUE_TRANSLATION_M,
    ConstraintKind,
)
from cartoloop.map_data import MapData

NEAR_M = 1.0
"""Nodes this close to a position are considered by :func:`explain_near` [m]."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """What is known of one pair.

    Attributes
    ----------
    submap, node : the pair.
    closure : its row in the record, None if it was never requested nor matched.
    status, reason : words of :class:`Status` and :class:`Reason`; for a pair without a row
        "not_requested" and why, in words.
    values : numbers behind the sentences, by the names of the columns of ``closures.csv``.
    sentences : what happened, in order.
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
        self._selection: PairSelection | None = None

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
        sentences = (
            *self._request_sentences(closure, values),
            *self._search_sentences(closure, values),
            *self._last_pass_sentences(closure, values),
            *self._residual_sentences(status, values),
        )
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
        if not (0 <= submap < graph.num_submaps and 0 <= node < graph.num_nodes):
            raise InputError(
                f"submap {submap}, node {node}: the map has submaps 0 to {graph.num_submaps - 1} "
                f"and nodes 0 to {graph.num_nodes - 1}"
            )
        row = self._closures.find(submap, node)
        if row is not None:
            return self.row(row)
        verdict = self._verdict(submap, node)
        why = "" if verdict.why_not is None else verdict.why_not.value
        return Explanation(
            submap,
            node,
            None,
            Status.NOT_REQUESTED.text,
            why,
            {"distance_m": verdict.distance, "path_length_m": verdict.path_length},
            (self._why_not_requested(verdict),),
        )

    def near(self, x: float, y: float, limit: int = 10) -> list[Explanation]:
        """Return the pairs of the nodes near a position [m], map frame, nearest nodes first.

        Of pairs never requested, that of the nearest node and the nearest submap that it was not
        inserted into.

        Raises
        ------
        InputError
            The map has no nodes.
        """
        graph = self._result.graph
        if graph.num_nodes == 0:
            raise InputError("the map has no nodes: nothing was mapped")
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
            "found_at": float(record.found_at[row]),
            "residual": float(record.residual[row]),
            "moved_m": float(record.moved[row, 0]),
            "moved_deg": math.degrees(record.moved[row, 1]),
        }
        if row < record.num_requested:
            values |= {
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

    def _request_sentences(self, row: int, values: dict[str, float]) -> list[str]:
        record = self._closures
        if row >= record.num_requested:
            verdict = self._verdict(int(record.submap[row]), int(record.node[row]))
            return [self._why_not_requested(verdict)]
        config = self._result.config.global_slam.constraint_search
        x, y, theta = record.predicted[row].tolist()
        drift = values["window_m"] - config.min_linear_search_window
        path = drift / config.linear_drift if config.linear_drift else math.nan
        is_full = values["window_m"] >= config.linear_search_window
        why = "the largest window" if is_full else f"the path between the two is {path:.1f} m long"
        return [
            f"Requested when the graph had {values['requested_at']:.0f} nodes. Predicted pose in "
            f"the submap: x {x:.2f} m, y {y:.2f} m, {math.degrees(theta):.1f} deg.",
            f"Search window radius: {values['window_m']:.2f} m, {values['window_deg']:.1f} deg "
            f"({why}).",
        ]

    def _search_sentences(self, row: int, values: dict[str, float]) -> list[str]:
        config = self._result.config.global_slam
        sentences = []
        if "min_score" in values:
            sentences.append(self._threshold_sentence(values["min_score"]))
        match Status(int(self._closures.search_status[row])):
            case Status.WAITING:
                sentences.append("The search had not ended when the run was stopped.")
            case Status.DROPPED:
                sentences.append(
                    f"Dropped: {config.max_live_backlog} other searches were waiting "
                    "(max_live_backlog)."
                )
            case Status.NOT_SEARCHED:
                sentences.append(
                    f"Not searched: {config.constraint_search.max_closures_of_pair} closures with "
                    "other nodes of the same submap had been found (max_closures_of_pair), or the "
                    "submap is empty."
                )
            case Status.NOT_FOUND:
                sentences.append("Searched: no candidate in the window reached the minimum score.")
            case Status.FOUND:
                sentences.append(_found_sentence(values))
        return sentences

    def _threshold_sentence(self, min_score: float) -> str:
        config = self._result.config.global_slam.constraint_search
        if min_score >= config.min_score:
            return f"Minimum score: {min_score:.3f} (min_score)."
        own = min_score / config.min_score_ratio
        return (
            f"Minimum score: {min_score:.3f}, {config.min_score_ratio:g} of the mean score of the "
            f"submap's own scans, {own:.3f} (min_score_ratio): less than min_score, "
            f"{config.min_score:g}."
        )

    def _last_pass_sentences(self, row: int, values: dict[str, float]) -> list[str]:
        reason = Reason(int(self._closures.reason[row]))
        if self._closures.has_final_match[row] and reason in (Reason.FITS, Reason.DISAGREES):
            sentence = "matched from the adjusted pose, {fit}: accepted."
        elif reason in _LAST_PASS:
            sentence = _LAST_PASS[reason]
        else:
            return []
        config = self._result.config.global_slam.constraint_search
        fit = (
            f"residual {values.get('residual', math.nan):.3f}, moved by "
            f"{values.get('moved_m', math.nan):.3f} m, {values.get('moved_deg', math.nan):.2f} deg"
        )
        degrees = math.degrees(config.max_refinement / config.lever)
        return ["Last pass: " + sentence.format(fit=fit, config=config, degrees=degrees)]

    def _residual_sentences(self, status: Status, values: dict[str, float]) -> list[str]:
        if "residual_m" not in values:
            return []
        sentences = [
            f"The map disagrees with the measured pose by {values['residual_m']:.3f} m and "
            f"{values['residual_deg']:.2f} deg; its weight there is {values['weight']:.2f}."
        ]
        if status == Status.CONTRADICTED:
            sentences.append(
                f"Removed from the graph: after the adjustment with it the residual was above "
                f"{TRUE_TRANSLATION_M:g} m or {math.degrees(TRUE_ROTATION_RAD):g} deg: the other "
                "constraints contradict it."
            )
        elif status in (Status.FINAL, Status.FOUND):
            sentences.append("It is a constraint of the graph.")
        return sentences

    def _why_not_requested(self, verdict: PairVerdict) -> str:
        apart = f"{verdict.distance:.1f} m apart, path of {verdict.path_length:.1f} m"
        if verdict.why_not is None:
            return (
                f"Never requested while mapping, though it would be at the final poses ({apart}): "
                "then the poses, or the number of nodes and submaps, were others."
            )
        return f"Never requested while mapping: {verdict.why_not.value} ({apart})."

    def _verdict(self, submap: int, node: int) -> PairVerdict:
        if self._selection is None:
            self._selection = selection_of(self._result)
        return self._selection.verdict(self._result.graph, submap, node)


def selection_of(result: MapData) -> PairSelection:
    """Return the choice of pairs as it is after all nodes and closures of a map."""
    graph = result.graph
    selection = PairSelection(result.config.global_slam.constraint_search)
    own = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
    first = np.full(graph.num_nodes, graph.num_submaps)
    last = np.zeros(graph.num_nodes, dtype=np.int64)
    np.minimum.at(first, graph.index_b[own], graph.index_a[own])
    np.maximum.at(last, graph.index_b[own], graph.index_a[own])
    positions = result.local_trajectory[result.node_scan_index, :2]
    for node, position in enumerate(positions.tolist()):
        num_points = len(result.node_points[node]) if node < len(result.node_points) else 0
        selection.add(tuple(position), num_points, (int(first[node]), int(last[node])))
    selection.note_requested(result.closures)
    closures = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    selection.note_adjusted(graph, closures)
    return selection


def _found_sentence(values: dict[str, float]) -> str:
    runner_up = values.get("runner_up", 0.0)
    other = (
        f"the best elsewhere in the window {runner_up:.3f}"
        if runner_up > 0.0
        else "no candidate elsewhere in the window reached the minimum"
    )
    return (
        f"Found: score {values.get('score', math.nan):.3f}, {other}. It joined the graph when that "
        f"had {values.get('found_at', math.nan):.0f} nodes."
    )


_LAST_PASS = {
    Reason.RESIDUAL: (
        "{fit}. Residual above the limit of {config.max_refined_residual:g} (max_refined_residual, "
        "more where the submap's own scans fit poorly)."
    ),
    Reason.TRANSLATION: "{fit}. Shift above {config.max_refinement:g} m (max_refinement).",
    Reason.ROTATION: "{fit}. Rotation above {degrees:.1f} deg (max_refinement).",
    Reason.START_RESIDUAL: (
        "at the adjusted pose the residual was above {config.max_start_residual:g} "
        "(max_start_residual); not matched again."
    ),
    Reason.EVERY_NTH_NODE: (
        "not matched again, one in {config.final_every_nth_node} nodes is (final_every_nth_node)."
    ),
    Reason.NO_OVERLAP: "at the adjusted poses the node is outside the submap's grid.",
    Reason.NEARER_SUBMAPS: (
        "{config.final_max_submaps_of_node} other submaps were nearer to the node "
        "(final_max_submaps_of_node)."
    ),
}
"""What the last pass came to, by the reason of a pair's status."""
