# SPDX-License-Identifier: Apache-2.0
"""Closures of the ends of sessions in corridors, which say nothing of the position along them.

Where one session ends in a bare corridor and another begins there, scans fit all along it: no place
is distinct, and no closure is made. Both sessions are held elsewhere only, and a degree of heading
moves their ends apart by metres, so that the corridor stands twice. But all places where scans fit
lie on one line, at one heading. Such scans hold the ends together across the corridor and in
heading, with a covariance as wide along it as the window that was searched.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray, RowArray
from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.closure_search import FinishedSubmap, refined
from cartoloop.global_slam.join_evidence import Nearby
from cartoloop.global_slam.join_records import NO_REQUESTS, as_one
from cartoloop.global_slam.pair_selection import PairSelection
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.sessions import SessionRanges
from cartoloop.scan_matching.branch_and_bound import NO_RUNNER_UP
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.session import session_numbers

MIN_WINDOW_M = 2.0
"""Where the drift is less, scans are found by other searches, or nothing stands twice [m]."""

SAME_LINE_M, SAME_LINE_RAD = 0.3, math.radians(1.0)
"""Matches are about one corridor if they agree so far across it [m], and in heading [rad]."""

MIN_NODES, MIN_SHARE, MIN_EXTENT_M = 4, 0.6, 1.0
"""Nodes that must agree on a line, their share of those that fit anywhere, and how far apart they
must be along the path [m]."""

SLOPE = 0.15
"""A single scan shows the direction of a corridor to some degrees."""

UNKNOWN_M = 1e3
"""Standard deviation of what is not known [m]."""


class Lines(NamedTuple):
    """Where nodes of one end of a session fit in another session.

    Attributes
    ----------
    nearby : n pairs and their matches, distinct or not.
    placed : float64, shape (n, 3), where each places the end node, map frame.
    direction : float64, shape (n,), that its scan hardly determines [rad], map frame.
    """

    nearby: Nearby
    placed: FloatArray
    direction: FloatArray

    @property
    def nodes(self) -> RowArray:
        """The nodes, int32, shape (n,)."""
        return self.nearby.requests.node


def lines_of_end(
    graph: PoseGraph,
    end: tuple[int, int, IntArray],
    pairs: PairSelection,
    submaps: Sequence[FinishedSubmap],
    node_points: ScanPoints,
    sessions: SessionRanges,
    config: ConstraintSearchConfig,
) -> dict[int, Lines]:
    """Return where the nodes of an end fit in each other session of the same part."""
    session, end_node, nodes = end
    of_submaps = session_numbers(sessions.first_submaps, len(submaps))
    parts = np.array(sessions.parts)
    is_other = (of_submaps != session) & (parts[of_submaps] == parts[session])
    nodes = nodes[node_points.take(nodes).counts >= config.min_num_points]
    wanted = [
        NO_REQUESTS,
        *(pairs.wide_pairs(graph, node, submaps, 0.0) for node in nodes.tolist()),
    ]
    requests = Requests._make(map(np.concatenate, zip(*wanted, strict=True)))
    requests = requests.take(
        np.flatnonzero(is_other[requests.submap] & (requests.linear_window >= MIN_WINDOW_M))
    )
    found: dict[int, list[Lines]] = {}
    for submap in np.unique(requests.submap).tolist():
        own = requests.take(np.flatnonzero(requests.submap == submap))
        lines = _lines_in(graph, end_node, own, submaps[submap], node_points, config)
        found.setdefault(int(of_submaps[submap]), []).append(lines)
    return {other: _as_one(each) for other, each in found.items()}


def _lines_in(
    graph: PoseGraph,
    end_node: int,
    requests: Requests,
    submap: FinishedSubmap,
    node_points: ScanPoints,
    config: ConstraintSearchConfig,
) -> Lines:
    """Return where nodes fit in one submap, distinct or not."""
    join = config.join
    min_score = min(join.min_score, join.min_score_ratio * submap.own_score)
    nodes = requests.node.astype(np.int64)
    scans = node_points.take(nodes)
    coarse = submap.matcher.match_all(
        scans,
        requests.tf_submap_node,
        linear_windows=requests.linear_window,
        angular_windows=requests.angular_window,
        min_score=min_score,
        groups=np.arange(len(nodes)),
        max_of_group=1,
        runner_up=NO_RUNNER_UP,
    )
    found = [(i, match) for i, match in enumerate(coarse.matches) if match is not None]
    met = np.array([i for i, _ in found], dtype=np.int64)
    unrecorded = np.full(len(met), -1, dtype=np.int32)
    matches, curvatures = refined(
        submap, scans.take(met), unrecorded, [match for _, match in found], config
    )
    submap.release()
    tf_map_submap = graph.submap_poses[submap.index]
    to_end = relative_all(graph.node_poses[nodes[met]], graph.node_poses[[end_node] * len(met)])
    placed = compose_all(tf_map_submap, compose_all(matches.tf_submap_node, to_end))
    xx, xy, yy = (curvatures[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
    weak = 0.5 * np.arctan2(2.0 * xy, xx - yy) + 0.5 * math.pi
    nearby = Nearby(requests.take(met), matches, np.full(len(met), min_score))
    return Lines(nearby, placed, weak + tf_map_submap[2])


def _as_one(several: Sequence[Lines]) -> Lines:
    """Return the matches in several submaps as one."""
    return Lines(
        as_one([each.nearby for each in several]),
        np.concatenate([each.placed for each in several]),
        np.concatenate([each.direction for each in several]),
    )


def on_one_line(lines: Lines, path: FloatArray) -> tuple[IntArray, float] | None:
    """Return the matches that agree on one corridor and its direction, None if they do not.

    Parameters
    ----------
    path : float64, shape (n,), path length at the node of each match [m].
    """
    best, direction = _most(lines)
    nodes = lines.nodes
    num_fitting = len(np.unique(nodes))
    count = len(np.unique(nodes[best]))
    if count < max(MIN_NODES, MIN_SHARE * num_fitting) or np.ptp(path[best]) < MIN_EXTENT_M:
        return None
    return np.flatnonzero(best), direction


def _most(lines: Lines) -> tuple[BoolArray, float]:
    """Return the matches on the line with the most nodes, and its direction."""
    best, best_count, best_direction = np.zeros(len(lines.placed), dtype=bool), 0, 0.0
    for seed in range(len(lines.placed)):
        direction = float(lines.direction[seed])
        on_line = _on_line(lines, seed, direction, SLOPE)
        # The line through the places shows the corridor better than one scan.
        offsets = lines.placed[on_line, :2] - lines.placed[on_line, :2].mean(axis=0)
        if np.hypot(*offsets.T).max(initial=0.0) > MIN_EXTENT_M:
            _, _, axes = np.linalg.svd(offsets, full_matrices=False)
            direction = math.atan2(axes[0, 1], axes[0, 0])
        on_line = _on_line(lines, seed, direction, 0.0)
        count = len(np.unique(lines.nodes[on_line]))
        if count > best_count:
            best, best_count, best_direction = on_line, count, direction
    return best, best_direction


def _on_line(lines: Lines, seed: int, direction: float, slope: float) -> BoolArray:
    """Return which matches are on the line through one of them.

    Parameters
    ----------
    slope : of other lines through it that count as well.
    """
    away = lines.placed[:, :2] - lines.placed[seed, :2]
    along = away @ (math.cos(direction), math.sin(direction))
    across = away @ (-math.sin(direction), math.cos(direction))
    turn = np.abs(wrap_angles(lines.placed[:, 2] - lines.placed[seed, 2]))
    is_on: BoolArray = (np.abs(across) <= SAME_LINE_M + slope * np.abs(along)) & (
        turn <= SAME_LINE_RAD
    )
    return is_on


class CorridorClosures(NamedTuple):
    """Closures that say nothing of the position along a corridor.

    Attributes
    ----------
    nearby : pairs and matches.
    angle : float64, shape (n,), of the corridor, submap axes [rad].
    informations : float64, shape (n, 3, 3), as they were measured.
    """

    nearby: Nearby
    angle: FloatArray
    informations: FloatArray

    def direction(self, graph: PoseGraph) -> float:
        """Return the direction of the corridor in the map, where a graph has the submaps [rad]."""
        return float(self.angle[0] + graph.submap_poses[self.nearby.requests.submap[0], 2])


def widened(lines: Lines, which: IntArray, graph: PoseGraph, direction: float) -> CorridorClosures:
    """Return some matches with a covariance as wide as their window along a direction of the map.

    Parameters
    ----------
    which : by index.
    """
    nearby = lines.nearby.take(which)
    requests = nearby.requests
    angle = direction - graph.submap_poses[requests.submap, 2]
    matches = _with_sigma_along(nearby.matches, angle, requests.linear_window)
    return CorridorClosures(nearby._replace(matches=matches), angle, nearby.matches.information)


def placed_along(closures: CorridorClosures, graph: PoseGraph, slide: float, step: float) -> Nearby:
    """Return closures with a place along the corridor.

    Matches that are at that place are true as they were measured. If there are too few, the others
    are moved there.

    Parameters
    ----------
    graph : adjusted with them.
    slide : by which the end is to be moved along the corridor from where the graph has it [m].
    step : between places that were compared [m].
    """
    requests, matches, min_score = closures.nearby
    seen = relative_all(graph.submap_poses[requests.submap], graph.node_poses[requests.node])
    axes = np.column_stack((np.cos(closures.angle), np.sin(closures.angle)))
    off = ((seen - matches.tf_submap_node)[:, :2] * axes) @ np.ones(2) + slide
    there = np.flatnonzero(np.abs(off) <= step)
    if len(np.unique(requests.node[there])) >= MIN_NODES:
        as_measured = matches._replace(information=closures.informations)
        return Nearby(requests, as_measured, min_score).take(there)
    poses = matches.tf_submap_node.copy()
    poses[:, :2] += off[:, np.newaxis] * axes
    moved = matches._replace(tf_submap_node=poses)
    # Errors are uniform between two places.
    moved = _with_sigma_along(moved, closures.angle, step / math.sqrt(12.0))
    return closures.nearby._replace(matches=moved)


def _with_sigma_along(
    matches: SearchMatches, angle: FloatArray, sigma: FloatArray | float
) -> SearchMatches:
    """Return matches with this standard deviation along an axis, besides that across it.

    Parameters
    ----------
    angle : float64, shape (n,), of the axis, submap axes [rad].
    """
    axes = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(len(angle))))
    along = axes[:, :, np.newaxis] * axes[:, np.newaxis]
    # Without what they said along the axis (Woodbury's identity: the information may be singular),
    # then with what is known of it.
    seen = np.einsum("nij,nj->ni", matches.information, axes)
    total = np.einsum("ni,ni->n", axes, seen) + UNKNOWN_M**-2
    outer = seen[:, :, np.newaxis] * seen[:, np.newaxis] / total[:, np.newaxis, np.newaxis]
    weight = (1.0 / np.broadcast_to(sigma, angle.shape) ** 2)[:, np.newaxis, np.newaxis]
    return matches._replace(information=matches.information - outer + weight * along)
