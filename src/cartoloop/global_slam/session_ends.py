# SPDX-License-Identifier: Apache-2.0
"""Ends of sessions in corridors, which no search finds in the other sessions of their part.

Scans there fit all along the corridor (:mod:`corridor_closures`). They hold the end across the
corridor and in heading. Where it is along it, all scans together show: at the right place hardly a
return lies on floor, and everywhere else doors and pillars lie there. If no place stands out, the
end stays where it was.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import GlobalSlamConfig
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.corridor_closures import (
    CorridorClosures,
    lines_of_end,
    on_one_line,
    placed_along,
    widened,
)
from cartoloop.global_slam.following import WINDOW_M
from cartoloop.global_slam.graph_adjustment import GraphAdjustment, violated_closures
from cartoloop.global_slam.join_evidence import (
    CheckGeometry,
    GeometryCheck,
    Nearby,
    Strictness,
    TwoParts,
)
from cartoloop.global_slam.pair_selection import PairSelection
from cartoloop.global_slam.pose_graph import ClosureConstraints, PoseGraph
from cartoloop.global_slam.sessions import NodeSubmaps, SessionRanges
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.session import session_numbers

END_M = 5.0
"""Path at either end of a session whose scans are searched [m]."""

STRETCH_M = 30.0
"""Path from an end along which its scans are compared with the other session [m]."""

STEP_M = 0.25
"""Places along the corridor are so far from each other [m]: twice the width of a door post."""

MAX_FLOOR_SHARE, MARGIN = 0.03, 0.03
"""At the right place at most this share of the returns lies on floor of the other session, and
everywhere else more by the margin."""

MIN_RETURNS = 300
"""Returns that can be compared at a place, at least, so that it can stand out: with these, the
margin is three standard errors of the share."""


class SessionEnds:
    """Finds closures that hold ends of sessions.

    Parameters
    ----------
    config : parameters.
    submaps : all, finished.
    sessions : and their parts.
    check : examines two parts; without it no end is held.
    """

    def __init__(
        self,
        config: GlobalSlamConfig,
        submaps: Sequence[FinishedSubmap],
        sessions: SessionRanges,
        check: CheckGeometry | None,
    ) -> None:
        self._config = config
        self._submaps = submaps
        self._sessions = sessions
        self._check = check

    def closures(
        self, graph: PoseGraph, pairs: PairSelection, node_points: ScanPoints
    ) -> Iterator[Nearby]:
        """Yield the closures of one end after the other; they have to be added before the next.

        Parameters
        ----------
        pairs : knows how far the drift may have moved scans.
        node_points : the returns of all nodes.
        """
        ends = session_ends(graph, self._sessions)
        for end in () if self._check is None or len(self._sessions) < 2 else tuple(ends):
            found = lines_of_end(
                graph,
                end,
                pairs,
                self._submaps,
                node_points,
                self._sessions,
                self._config.constraint_search,
            )
            for other, lines in sorted(found.items()):
                on_line = on_one_line(lines, _path(graph)[lines.nodes])
                if on_line is None:
                    continue
                closures = widened(lines, on_line[0], graph, on_line[1])
                held = self._held(graph, closures, end, other, node_points)
                if held is not None:
                    yield held
                    break

    def _held(
        self,
        graph: PoseGraph,
        closures: CorridorClosures,
        end: tuple[int, int, IntArray],
        other: int,
        node_points: ScanPoints,
    ) -> Nearby | None:
        """Return closures with the place along the corridor, None if none stands out."""
        assert self._check is not None
        across = self._adjusted(graph, closures.nearby)
        parts = self._two_parts(across, end, other, node_points)
        slide = _place_along(parts, closures.direction(across), self._check)
        if slide is None:
            return None
        placed = placed_along(closures, across, slide, STEP_M)
        adjusted = self._adjusted(graph, placed)
        check = self._check(
            self._two_parts(adjusted, end, other, node_points), Strictness.FEW_DISTINCT
        )
        num_before, num_after = (int(violated_closures(g)[1].sum()) for g in (graph, adjusted))
        return None if check.fault or num_after > num_before else placed

    def _adjusted(self, graph: PoseGraph, nearby: Nearby) -> PoseGraph:
        """Return a copy of a graph with closures, adjusted as while mapping."""
        copy, (requests, matches, _) = graph.copy(), nearby
        copy.add_loop_closures(
            ClosureConstraints(
                matches.row,
                requests.submap,
                requests.node,
                matches.tf_submap_node,
                matches.information,
            ),
            are_trusted=True,
        )
        config = self._config.pose_adjustment
        GraphAdjustment(copy, self._config, config.mapping_share).run(
            config.max_num_final_iterations
        )
        return copy

    def _two_parts(
        self,
        graph: PoseGraph,
        end: tuple[int, int, IntArray],
        other: int,
        node_points: ScanPoints,
    ) -> TwoParts:
        """Return the stretch of a session at its end, and another session."""
        session, end_node, _ = end
        path, sessions = _path(graph), self._sessions
        of_nodes = session_numbers(sessions.first_nodes, graph.num_nodes)
        of_submaps = session_numbers(sessions.first_submaps, graph.num_submaps)
        stretch = np.flatnonzero(
            (of_nodes == session) & (np.abs(path - path[end_node]) <= STRETCH_M)
        )
        nodes = np.where(of_nodes == other, 1, -1)
        submaps = np.where(of_submaps == other, 1, -1)
        nodes[stretch] = 0
        submaps[NodeSubmaps.of(graph).first[stretch]] = 0
        return TwoParts(graph, self._submaps, node_points, nodes, submaps)


def session_ends(graph: PoseGraph, sessions: SessionRanges) -> Iterator[tuple[int, int, IntArray]]:
    """Yield session, end node and the nodes near it, of the beginning and the end of each."""
    lasts = [*sessions.first_nodes[1:], graph.num_nodes]
    for session, (first, last) in enumerate(zip(sessions.first_nodes, lasts, strict=True)):
        nodes = np.arange(first, last)
        if len(nodes) == 0:
            continue
        steps = np.hypot(*np.diff(graph.node_poses[nodes, :2], axis=0).T)
        path = np.concatenate(([0.0], np.cumsum(steps)))
        yield session, first, nodes[path <= END_M]
        yield session, last - 1, nodes[path >= path[-1] - END_M]


def _place_along(parts: TwoParts, direction: float, check: CheckGeometry) -> float | None:
    """Return by how far part 0 has to be moved along a direction [m], None if that is open."""
    axis = np.array((math.cos(direction), math.sin(direction)))
    slides = np.arange(-WINDOW_M, WINDOW_M + 0.5 * STEP_M, STEP_M)

    def checked(place: int, strictness: Strictness) -> GeometryCheck:
        return check(_moved(parts, float(slides[place]) * axis), strictness)

    # What contradicts takes five times as long to find, and matters at the best place alone.
    counts = [checked(place, Strictness.COUNTS_ONLY) for place in range(len(slides))]
    return standing_out(
        slides,
        counts,
        lambda best: checked(best, Strictness.NO_OTHER_PLACE).contradicted > 0.0,
    )


def standing_out(
    slides: FloatArray, checks: Sequence[GeometryCheck], contradicts: Callable[[int], bool]
) -> float | None:
    """Return the place along a corridor that stands out, None if none does.

    Parameters
    ----------
    slides : float64, shape (n,), ascending [m].
    checks : of each.
    contradicts : whether scans contradict a place, by its index; asked of one that stands out.
    """
    shares = np.array([each.floor_share for each in checks])
    counts = np.array([each.on_wall + each.on_floor for each in checks])
    shares[counts < MIN_RETURNS] = 1.0
    best = int(np.argmin(shares))
    near = np.abs(slides - slides[best]) <= 2.0 * STEP_M
    # A place that cannot be compared does not show that it is wrong.
    limits = np.array([each.floor_share for each in checks])[~near & (counts >= MIN_RETURNS / 5)]
    if shares[best] > MAX_FLOOR_SHARE:
        return None
    if len(limits) == 0 or limits.min() < shares[best] + MARGIN or contradicts(best):
        return None
    fits = near & (shares < shares[best] + 0.5 * MARGIN)
    return float(slides[fits].mean())


def _moved(parts: TwoParts, offset: FloatArray) -> TwoParts:
    """Return two parts with part 0 moved."""
    graph = parts.graph.copy()
    graph.node_poses[parts.of_nodes == 0, :2] += offset
    graph.submap_poses[parts.of_submaps == 0, :2] += offset
    return TwoParts(graph, parts.submaps, parts.node_points, parts.of_nodes, parts.of_submaps)


def _path(graph: PoseGraph) -> FloatArray:
    """Return the length of the path at each node [m]."""
    steps = np.hypot(*np.diff(graph.node_poses[:, :2], axis=0).T)
    return np.concatenate(([0.0], np.cumsum(steps)))
