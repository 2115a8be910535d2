# SPDX-License-Identifier: Apache-2.0
"""The last pass over a finished run: every node is matched again to the submaps that it overlaps.

From adjusted poses no search is necessary: (CS) alone finds the match, and measures the relative
pose more exactly than the searches while mapping.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closure_matches import FinalMatches, Matched
from cartoloop.global_slam.closure_search import FinishedSubmap, refine_all
from cartoloop.global_slam.closure_status import STATUS_OF_REASON, Reason, Status
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.constraint_search import ConstraintSearch
from cartoloop.global_slam.kept_closures import with_kept_closures
from cartoloop.global_slam.pose_graph import ClosureConstraints, PoseGraph
from cartoloop.global_slam.sessions import SessionRanges
from cartoloop.scan_matching.least_squares import match_informations
from cartoloop.sensor.pose import relative_all
from cartoloop.sensor.scan_points import ScanPoints


class FinalLimits(NamedTuple):
    """What the last pass accepts in one submap.

    Attributes
    ----------
    residual : root mean square of 1 - M_smooth at the returns.
    translation, rotation : from the adjusted pose to the match [m], [rad].
    """

    residual: float
    translation: float
    rotation: float


def final_limits(config: ConstraintSearchConfig, submap: FinishedSubmap) -> FinalLimits:
    """Return what is accepted in a submap.

    Where not even its own scans fit a submap well, the residual may be larger by as much as the
    minimum score of the search is lower there. Where they are sparse, they fit better than others
    do, which meet the holes that they left in the walls.
    """
    allowance = max(config.min_score - config.min_score_ratio * submap.own_score, 0.0)
    if submap.is_sparse:
        allowance = max(allowance, config.sparse_residual)
    return FinalLimits(
        config.max_refined_residual + allowance,
        config.max_refinement,
        config.max_refinement / config.lever,
    )


def overlapping_nodes(
    submap: FinishedSubmap,
    tf_map_submap: FloatArray,
    node_poses: FloatArray,
    inserted: set[int],
    every: int,
) -> IntArray:
    """Return one in `every` of the nodes inside a submap's grid that were not inserted into it."""
    grid = submap.grid
    seen = relative_all(tf_map_submap, node_poses)
    height, width = grid.shape
    x, y = seen[:, 0] - grid.origin_x, seen[:, 1] - grid.origin_y
    inside = (x > 0.0) & (y > 0.0) & (x < width * grid.resolution) & (y < height * grid.resolution)
    nodes = np.flatnonzero(inside)
    nodes = nodes[(nodes + submap.index) % every == 0]
    others: IntArray = nodes[np.isin(nodes, np.fromiter(inserted, np.int64), invert=True)]
    return others


def in_nearest_submaps(
    overlapping: Sequence[IntArray], submap_poses: FloatArray, node_poses: FloatArray, limit: int
) -> list[IntArray]:
    """Return the nodes to match in each submap: each node in its `limit` nearest submaps only.

    Where the robot returns often, many submaps overlap, and to match a node to each of them takes
    ever longer and adds little information.

    Parameters
    ----------
    overlapping : of each submap, the nodes that overlap it.
    submap_poses, node_poses : shapes (m, 3), (n, 3), of all.
    """
    counts = [len(nodes) for nodes in overlapping]
    nodes, submaps = np.concatenate(overlapping), np.repeat(np.arange(len(counts)), counts)
    apart = node_poses[nodes, :2] - submap_poses[submaps, :2]
    nearest_first = np.lexsort((submaps, np.hypot(apart[:, 0], apart[:, 1]), nodes))
    of_node = nodes[nearest_first]
    rank = np.arange(len(nodes)) - np.searchsorted(of_node, of_node)
    is_near = np.empty(len(nodes), dtype=bool)
    is_near[nearest_first] = rank < limit
    parts = np.split(is_near, np.cumsum(counts)[:-1])
    return [nodes[near] for nodes, near in zip(overlapping, parts, strict=True)]


def why_not_matched(
    found: Matched, overlapping: Sequence[IntArray], selected: Sequence[IntArray], every: int
) -> NDArray[np.int8]:
    """Return why closures that searches found were not matched again, if they were not.

    Parameters
    ----------
    found : n closures.
    overlapping : of each submap, the nodes that overlap it.
    selected : those of them that were to be matched: of the others, nearer submaps were.
    every : one in `every` nodes is matched, ``final_every_nth_node``.

    Returns
    -------
    :class:`Reason` of each, shape (n,).
    """
    reasons = np.full(len(found), Reason.NO_OVERLAP, dtype=np.int8)
    for submap in np.unique(found.submap).tolist():
        own = np.flatnonzero(found.submap == submap)
        reasons[own[np.isin(found.node[own], overlapping[submap])]] = Reason.NEARER_SUBMAPS
        reasons[own[np.isin(found.node[own], selected[submap])]] = Reason.START_RESIDUAL
    reasons[(found.node.astype(np.int64) + found.submap) % every != 0] = Reason.EVERY_NTH_NODE
    return reasons


def match_again(
    submap: FinishedSubmap,
    tf_map_submap: FloatArray,
    nodes: IntArray,
    node_poses: FloatArray,
    node_points: ScanPoints,
    config: ConstraintSearchConfig,
) -> FinalMatches:
    """Match nodes to a submap near their adjusted poses.

    Nodes with few returns are left out, and nodes that do not see the same as the submap: those
    with a residual above ``max_start_residual`` at the adjusted pose.

    Parameters
    ----------
    tf_map_submap : shape (3,).
    nodes : indices of those to match.
    node_poses : shape (n, 3), of all nodes.
    node_points : the returns of all nodes.
    """
    nodes = nodes[node_points.take(nodes).counts >= config.min_num_points]
    if len(nodes) == 0:
        return NO_FINAL_MATCHES
    starts = relative_all(tf_map_submap, node_poses[nodes])
    matches = refine_all(
        submap.smooth_map, node_points.take(nodes), starts, config, config.max_start_residual
    )
    tried = np.flatnonzero(np.isfinite(matches.residual))
    poses, residual = matches.tf_submap_scan[tried], matches.residual[tried]
    moved = poses - starts[tried]
    moved_m, moved_rad = np.hypot(moved[:, 0], moved[:, 1]), np.abs(moved[:, 2])
    reasons = _reasons(residual, moved_m, moved_rad, final_limits(config, submap))
    fitting = reasons == Reason.FITS
    informations = np.zeros((len(tried), 3, 3))
    if fitting.any():
        informations[fitting] = match_informations(
            matches.information[tried[fitting]], residual[fitting]
        )
    return FinalMatches(
        submap=np.full(len(tried), submap.index),
        node=nodes[tried],
        tf_submap_node=poses,
        information=informations,
        residual=residual,
        moved_m=moved_m,
        moved_rad=moved_rad,
        reason=reasons,
    )


def _reasons(
    residual: FloatArray, moved_m: FloatArray, moved_rad: FloatArray, limits: FinalLimits
) -> NDArray[np.int8]:
    """Return FITS, or the first test that a match fails, shape (n,)."""
    reasons = np.full(len(residual), Reason.FITS, dtype=np.int8)
    reasons[~(moved_rad <= limits.rotation)] = Reason.ROTATION
    reasons[~(moved_m <= limits.translation)] = Reason.TRANSLATION
    reasons[~(residual <= limits.residual)] = Reason.RESIDUAL
    return reasons


class LastPass:
    """Matches the nodes of a map to the submaps that they overlap at its adjusted poses.

    Parameters
    ----------
    config : limits.
    graph : with adjusted poses; its loop closures are replaced.
    submaps : all submaps, finished.
    submap_nodes : of each, the nodes that were inserted into it.
    node_points : the returns of all nodes.
    sessions : pairs of parts that are not connected are not matched.
    """

    def __init__(
        self,
        config: ConstraintSearchConfig,
        graph: PoseGraph,
        submaps: Sequence[FinishedSubmap],
        submap_nodes: Sequence[set[int]],
        node_points: ScanPoints,
        sessions: SessionRanges,
    ) -> None:
        self._config = config
        self._graph = graph
        self._submaps = submaps
        self._submap_nodes = submap_nodes
        self._node_points = node_points
        self._sessions = sessions
        self._node_parts = sessions.of_nodes(graph.num_nodes)
        self._submap_parts = sessions.of_submaps(graph.num_submaps)

    def run(self, closures: Closures, search: ConstraintSearch) -> None:
        """Match again, record the matches, and replace the loop closures."""
        config, graph = self._config, self._graph
        numbers = range(len(self._submaps))
        overlapping = list(search.map(self._overlapping, numbers))
        nodes = in_nearest_submaps(
            overlapping, graph.submap_poses, graph.node_poses, config.final_max_submaps_of_node
        )
        # All matches first: a run that is stopped meanwhile keeps the closures of the searches.
        passes = list(search.map(lambda index: self._match(index, nodes[index]), numbers))
        found = closures.found
        passes = with_kept_closures(passes, found, graph, self._sessions)
        not_matched = why_not_matched(found, overlapping, nodes, config.final_every_nth_node)
        rows = closures.note_last_pass(not_matched, passes)
        trusted = graph.closure_rows[graph.is_trusted]
        graph.replace_loop_closures(map(_accepted, passes, rows))
        # Few of them hold a session that the chain of submaps would let go again.
        kept = [each[match.reason == Reason.KEPT] for each, match in zip(rows, passes, strict=True)]
        stays = np.intersect1d(trusted, np.concatenate([np.zeros(0, np.int64), *kept]))
        graph.is_trusted[np.isin(graph.closure_rows, stays[stays >= 0])] = True

    def _overlapping(self, submap: int) -> IntArray:
        graph = self._graph
        nodes = overlapping_nodes(
            self._submaps[submap],
            graph.submap_poses[submap],
            graph.node_poses,
            self._submap_nodes[submap],
            self._config.final_every_nth_node,
        )
        own_part: IntArray = nodes[self._node_parts[nodes] == self._submap_parts[submap]]
        return own_part

    def _match(self, index: int, nodes: IntArray) -> FinalMatches:
        submap, graph = self._submaps[index], self._graph
        pose = graph.submap_poses[index]
        matches = match_again(
            submap, pose, nodes, graph.node_poses, self._node_points, self._config
        )
        submap.release()
        return matches


def _accepted(matches: FinalMatches, rows: NDArray[np.int64]) -> ClosureConstraints:
    """Return the matches of a pass that become constraints."""
    fits = STATUS_OF_REASON[matches.reason] == Status.FINAL
    return ClosureConstraints(
        rows[fits],
        matches.submap[fits],
        matches.node[fits],
        matches.tf_submap_node[fits],
        matches.information[fits],
    )


NO_FINAL_MATCHES = FinalMatches(
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
    np.zeros((0, 3)),
    np.zeros((0, 3, 3)),
    np.zeros(0),
    np.zeros(0),
    np.zeros(0),
    np.zeros(0, np.int8),
)
