# SPDX-License-Identifier: Apache-2.0
"""The graph and the loop closures of a folder that a run wrote."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from os import PathLike
from pathlib import Path

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.errors import InputError
from cartoloop.global_slam.closure_matches import Matched
from cartoloop.global_slam.closure_residuals import residuals, weights
from cartoloop.global_slam.closure_status import Status
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.result import Result, load_map
from cartoloop.session import session_numbers


class Stage(StrEnum):
    """Which closures are judged."""

    FOUND = "found"
    """Those that searches found while mapping, as they measured them."""
    FINAL = "final"
    """Those in the finished graph."""
    REJECTED = "rejected"
    """Those removed from the graph at the end, because the others contradict them."""


@dataclass(frozen=True)
class StageClosures:
    """Loop closures of one stage, row by row.

    Attributes
    ----------
    submap, node : int64 (k,), indices in the graph.
    tf_submap_node : float64 (k, 3), where the node was seen [m, m, rad].
    score, runner_up : float64 (k,), NaN where no search found the pair.
    residual_m, residual_deg : float64 (k,), by how much the final poses disagree.
    weight : float64 (k,), factor of its information under the robust loss, in [0, 1].
    """

    submap: IntArray
    node: IntArray
    tf_submap_node: FloatArray
    score: FloatArray
    runner_up: FloatArray
    residual_m: FloatArray
    residual_deg: FloatArray
    weight: FloatArray

    def __len__(self) -> int:
        return len(self.submap)


@dataclass(frozen=True)
class FinishedRun:
    """What a run wrote of its graph.

    Attributes
    ----------
    folder : where it was read from.
    stamps : float64 (n,), names of the nodes' scans [s].
    node_poses, submap_poses : float64 (n, 3), (s, 3), optimised [m, m, rad].
    own_submap, own_node : int64 (m,), which nodes were inserted into which submaps.
    own_pose : float64 (m, 3), where each was inserted, tf_submap_node [m, m, rad].
    node_sessions : int64 (n,), which session each node is of.
    closures : by stage.
    """

    folder: Path
    stamps: FloatArray
    node_poses: FloatArray
    submap_poses: FloatArray
    own_submap: IntArray
    own_node: IntArray
    own_pose: FloatArray
    node_sessions: IntArray
    closures: dict[Stage, StageClosures]

    @property
    def num_nodes(self) -> int:
        """How many nodes there are."""
        return len(self.node_poses)

    @property
    def num_submaps(self) -> int:
        """How many submaps there are."""
        return len(self.submap_poses)

    def first_submap(self) -> IntArray:
        """Return the oldest submap that each node was inserted into, shape (n,)."""
        first = np.full(self.num_nodes, self.num_submaps, dtype=np.int64)
        np.minimum.at(first, self.own_node, self.own_submap)
        return first


def read_run(folder: str | PathLike[str]) -> FinishedRun:
    """Return what ``cartoloop map`` wrote of the graph into a folder.

    Raises
    ------
    InputError
        ``map.cartoloop`` is missing or damaged, or nothing was mapped.
    """
    folder = Path(folder)
    result = load_map(folder)
    graph, closures = result.graph, result.closures
    if graph.num_nodes == 0:
        raise InputError(f"{folder}: has no nodes: nothing was mapped")
    own = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
    own = own[np.lexsort((graph.index_a[own], graph.index_b[own]))]
    return FinishedRun(
        folder=folder,
        stamps=result.stamps[result.node_scan_index],
        node_poses=graph.node_poses,
        submap_poses=graph.submap_poses,
        own_submap=graph.index_a[own],
        own_node=graph.index_b[own],
        own_pose=graph.relative_poses[own],
        node_sessions=session_numbers(
            [session.first_node for session in result.sessions], graph.num_nodes
        ),
        closures={
            Stage.FOUND: _closures(closures.found, result),
            Stage.FINAL: _closures(closures.with_status(*_IN_GRAPH), result),
            Stage.REJECTED: _closures(closures.with_status(Status.CONTRADICTED), result),
        },
    )


_IN_GRAPH = (Status.FINAL, Status.FOUND, Status.ADDED)


def _closures(matched: Matched, result: Result) -> StageClosures:
    poses = result.graph.submap_poses, result.graph.node_poses
    metres, radians = residuals(matched, *poses)
    return StageClosures(
        submap=matched.submap.astype(np.int64),
        node=matched.node.astype(np.int64),
        tf_submap_node=matched.tf_submap_node,
        score=matched.score,
        runner_up=matched.runner_up,
        residual_m=metres,
        residual_deg=np.degrees(radians),
        weight=weights(matched, *poses, result.config.global_slam.pose_adjustment),
    )
