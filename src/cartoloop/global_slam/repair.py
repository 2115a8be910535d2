# SPDX-License-Identifier: Apache-2.0
"""Closures that make visits agree which contradict each other in the finished map.

Where a robot comes back to a place at another side or from a distance, a scan shares little of what
it sees with the submaps there: its score is below the threshold of any search, and walls stand
twice, a few decimetres apart. The examination of the map finds such visits. Here they are searched
in the submaps that they contradict: several scans as one, those returns only that lie where the
submap has observed anything, in a small window. What fits is believed if the map contradicts
itself less with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import AdaptiveVoxelFilterConfig, GlobalSlamConfig
from cartoloop.global_slam.closure_matches import FinalMatches
from cartoloop.global_slam.closure_search import FinishedSubmap, refined
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.constraint_search import ConstraintSearch
from cartoloop.global_slam.graph_adjustment import GraphAdjustment
from cartoloop.global_slam.pose_adjustment import constraint_residuals
from cartoloop.global_slam.pose_graph import (
    NO_ROW,
    ClosureConstraints,
    ConstraintKind,
    PoseGraph,
)
from cartoloop.global_slam.refinement import NO_FINAL_MATCHES
from cartoloop.scan_matching.branch_and_bound import RunnerUp
from cartoloop.sensor.pose import Pose, relative_all, transform_points, wrap_angles
from cartoloop.sensor.range_filter import thin
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid

SCAN_FILTER = AdaptiveVoxelFilterConfig(max_length=0.5, min_num_points=300, max_range=30.0)
"""Of the returns of several scans that are searched as one."""

NEAR_OBSERVED_M = 0.2
"""Returns farther from all that a submap observed are left out [m]: they say nothing about it."""

MIN_RETURNS = 60
"""With fewer returns that can be compared, nothing is searched."""

MAX_TEAR_M = 0.5
"""A match that moves its node by more within the submaps that it was inserted into is false [m]:
what leads a visit astray bends its path, and does not take one scan out of it."""


class Contradicted(NamedTuple):
    """A visit that contradicts a submap.

    Attributes
    ----------
    submap : its index.
    node : in the middle of the visit.
    tf_submap_node : of this node by the map.
    """

    submap: int
    node: int
    tf_submap_node: Pose


class Contradictions(NamedTuple):
    """How far a map contradicts itself.

    Attributes
    ----------
    visits : those that contradict a submap.
    length : of their path [m].
    paths : float64, shape (num_nodes,), length of the path at each node of the map [m]; sessions
        are far apart.
    """

    visits: Sequence[Contradicted]
    length: float
    paths: FloatArray


FindContradictions = Callable[[PoseGraph], Contradictions]
"""Examines the map with the poses of a graph."""


class Repaired(NamedTuple):
    """What makes visits agree.

    Attributes
    ----------
    closures : the matches, with the reason REPAIR.
    graph : a copy of the map's, adjusted with them.
    before, after : path along which visits contradict each other [m].
    """

    closures: FinalMatches
    graph: PoseGraph
    before: float
    after: float

    def summary(self) -> dict[str, Any]:
        """Return the key of the report."""
        return {
            "repair": {
                "closures": len(self.closures.node),
                "contradicted_before_m": round(self.before, 1),
                "contradicted_after_m": round(self.after, 1),
            }
        }

    def without_matched(self, graph: PoseGraph) -> FinalMatches:
        """Return the closures whose pairs are no constraints of a graph."""
        rows = [
            index
            for index, (submap, node) in enumerate(
                zip(self.closures.submap.tolist(), self.closures.node.tolist(), strict=True)
            )
            if not np.any((graph.index_a == submap) & (graph.index_b == node))
        ]
        return FinalMatches._make(column[rows] for column in self.closures)


class Repair:
    """Finds the closures of one finished map.

    Parameters
    ----------
    config : parameters.
    submaps : all, in their order.
    node_points : the returns of all nodes [m], tracking frame.
    search : whose threads are used.
    """

    def __init__(
        self,
        config: GlobalSlamConfig,
        submaps: Sequence[FinishedSubmap],
        node_points: ScanPoints,
        search: ConstraintSearch,
    ) -> None:
        self._config = config
        self._submaps = submaps
        self._node_points = node_points
        self._search = search

    def run(self, graph: PoseGraph, find: FindContradictions) -> Repaired | None:
        """Return what makes visits agree, None if nothing does.

        Parameters
        ----------
        graph : adjusted; it is not changed.
        find : examines a copy of it with other poses.
        """
        limits = self._config.constraint_search.repair
        contradictions = find(graph)
        before, tried = contradictions.length, set[tuple[int, int]]()
        if before < limits.min_length:
            return None
        found, best = NO_FINAL_MATCHES, None
        for _ in range(limits.max_rounds):
            new = self._matches(graph, contradictions, tried)
            if len(new.node) == 0:
                break
            graph, new = self._adjusted(graph, new)
            found = _together((found, new))
            contradictions = find(graph)
            if contradictions.length < (before if best is None else best.after):
                best = Repaired(found, graph, before, contradictions.length)
        if best is None or best.after > limits.max_remaining_share * before:
            return None
        return best

    def _matches(
        self, graph: PoseGraph, contradictions: Contradictions, tried: set[tuple[int, int]]
    ) -> FinalMatches:
        """Return the matches of visits that were not tried before, and note that they were."""
        by_submap: dict[int, list[Contradicted]] = {}
        for visit in contradictions.visits:
            if (visit.submap, visit.node) not in tried:
                tried.add((visit.submap, visit.node))
                by_submap.setdefault(visit.submap, []).append(visit)
        paths = contradictions.paths

        def match(submap: int) -> FinalMatches:
            finished = self._submaps[submap]
            found = [self._match(finished, visit, graph, paths) for visit in by_submap[submap]]
            finished.release()
            return _together(found)

        return _together(self._search.map(match, sorted(by_submap)))

    def _match(
        self, submap: FinishedSubmap, visit: Contradicted, graph: PoseGraph, paths: FloatArray
    ) -> FinalMatches:
        """Return the match of one visit to a submap, if it is distinct."""
        search = self._config.constraint_search
        limits = search.repair
        points = self._composite(visit.node, graph, paths)
        is_near = near_observed(submap.grid, visit.tf_submap_node, points)
        points = thin(points[is_near], SCAN_FILTER)
        if len(points) < MIN_RETURNS:
            return NO_FINAL_MATCHES
        scans = ScanPoints.of([points])
        start = np.array([visit.tf_submap_node])
        best = submap.matcher.match_all(
            scans,
            start,
            linear_windows=np.array([limits.linear_window]),
            angular_windows=np.array([math.radians(limits.angular_window_deg)]),
            min_score=limits.min_score,
            groups=np.zeros(1, np.int64),
            max_of_group=1,
            runner_up=RunnerUp(min_score=limits.min_score - limits.min_margin),
        ).matches[0]
        if best is None or best.score - best.runner_up < limits.min_margin:
            return NO_FINAL_MATCHES
        match, curvatures = refined(submap, scans, np.zeros(1, np.int32), [best], search)
        if determined_share(curvatures[0]) < limits.min_determined:
            return NO_FINAL_MATCHES
        moved = match.tf_submap_node - start
        return FinalMatches(
            np.array([visit.submap]),
            np.array([visit.node]),
            match.tf_submap_node,
            match.information,
            match.residual,
            np.hypot(moved[:, 0], moved[:, 1]),
            np.abs(wrap_angles(moved[:, 2])),
            np.array([Reason.REPAIR], dtype=np.int8),
        )

    def _composite(self, node: int, graph: PoseGraph, paths: FloatArray) -> FloatArray:
        """Return the returns of the nodes along the path around a node, in its frame."""
        length = self._config.constraint_search.repair.length
        nodes = np.flatnonzero(np.abs(paths - paths[node]) <= 0.5 * length)
        poses = relative_all(graph.node_poses[node], graph.node_poses[nodes])
        return np.concatenate(
            [
                transform_points(Pose(*pose), self._node_points[other])
                for pose, other in zip(poses.tolist(), nodes.tolist(), strict=True)
            ]
        )

    def _adjusted(self, graph: PoseGraph, closures: FinalMatches) -> tuple[PoseGraph, FinalMatches]:
        """Return a copy of a graph, adjusted with more closures, and those of them that hold."""
        adjusted = graph.copy()
        add_closures(adjusted, closures, np.full(len(closures.node), NO_ROW))
        config = self._config.pose_adjustment
        GraphAdjustment(adjusted, self._config, config.mapping_share).run(
            config.max_num_final_iterations
        )
        is_torn = are_torn(adjusted, closures.node)
        if not is_torn.any():
            return adjusted, closures
        return self._adjusted(graph, FinalMatches._make(column[~is_torn] for column in closures))


def add_closures(graph: PoseGraph, closures: FinalMatches, rows: IntArray) -> None:
    """Add closures to a graph, which are believed.

    Parameters
    ----------
    rows : of the record of closures, or `NO_ROW`.
    """
    columns = (closures.submap, closures.node, closures.tf_submap_node, closures.information)
    graph.add_loop_closures(ClosureConstraints(rows, *columns), are_trusted=True)


def are_torn(graph: PoseGraph, nodes: IntArray) -> BoolArray:
    """Return which nodes were moved within the submaps that they were inserted into, shape (n,)."""
    inside = np.flatnonzero(
        (graph.kinds == ConstraintKind.INTRA_SUBMAP) & np.isin(graph.index_b, nodes)
    )
    translation_error, _ = constraint_residuals(graph, inside)
    is_torn: BoolArray = np.isin(nodes, graph.index_b[inside[translation_error > MAX_TEAR_M]])
    return is_torn


def determined_share(curvature: FloatArray) -> float:
    """Return how well a match determines its worst direction, as a share of its best one.

    Parameters
    ----------
    curvature : float64, shape (3, 3), of (CS): x, y, theta. The heading is free.
    """
    translation, turned = curvature[:2, :2], curvature[:2, 2]
    if curvature[2, 2] <= 0.0:
        return 0.0
    least, most = np.linalg.eigvalsh(translation - np.outer(turned, turned) / curvature[2, 2])
    return float(max(least, 0.0) / most) if most > 0.0 else 0.0


def near_observed(grid: FinishedGrid, tf_submap_node: Pose, points: FloatArray) -> BoolArray:
    """Return which points lie near cells that were observed, shape (n,)."""
    from scipy import ndimage  # takes a while, and few maps are repaired

    reach = round(NEAR_OBSERVED_M / grid.resolution)
    observed = ndimage.binary_dilation(np.pad(grid.cells != 0, reach), iterations=reach)
    placed = transform_points(tf_submap_node, points)
    cols, rows = (
        np.rint((placed[:, axis] - origin) / grid.resolution).astype(np.int64) + reach
        for axis, origin in enumerate((grid.origin_x, grid.origin_y))
    )
    height, width = observed.shape
    is_near: BoolArray = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
    is_near[is_near] = observed[rows[is_near], cols[is_near]]
    return is_near


def _together(matches: Iterable[FinalMatches]) -> FinalMatches:
    return FinalMatches._make(map(np.concatenate, zip(NO_FINAL_MATCHES, *matches, strict=True)))
