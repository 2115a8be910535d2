# SPDX-License-Identifier: Apache-2.0
"""Whether two parts of a map agree where they overlap, before they are joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import JoinConfig, QualityConfig
from cartoloop.global_slam.join_evidence import GeometryCheck
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.quality.encounters import Encounters, encounters
from cartoloop.quality.pairs import compared_pairs, path_lengths
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.session import Session
from cartoloop.submaps.finished_grid import FinishedGrid


class _HasGrid(Protocol):
    @property
    def grid(self) -> FinishedGrid: ...


@dataclass(frozen=True)
class _Parts:
    """Two parts as content to be compared."""

    graph: PoseGraph
    submap_grids: list[FinishedGrid]
    node_points: Sequence[NDArray[np.float64]]

    @property
    def stamps(self) -> FloatArray:
        return np.zeros(0)

    @property
    def trajectory(self) -> FloatArray:
        return np.zeros((0, 3))

    @property
    def local_trajectory(self) -> FloatArray:
        return np.zeros((0, 3))

    @property
    def sessions(self) -> tuple[Session, ...]:
        return (Session(),)

    @property
    def node_parts(self) -> IntArray:
        return np.zeros(self.graph.num_nodes, np.int64)

    @property
    def submap_parts(self) -> IntArray:
        return np.zeros(self.graph.num_submaps, np.int64)

    @property
    def node_scan_index(self) -> IntArray:
        return np.zeros(0, np.int64)


def check_geometry(
    graph: PoseGraph,
    submaps: Sequence[_HasGrid],
    node_points: ScanPoints,
    node_parts: IntArray,
    submap_parts: IntArray,
    quality: QualityConfig,
    join: JoinConfig,
) -> GeometryCheck:
    """Return how well the scans of either of two parts agree with the submaps of the other.

    Parameters
    ----------
    graph : in which they are placed.
    submaps : the first ones of the graph, finished.
    node_points : the returns of all nodes.
    node_parts, submap_parts : 0 and 1 for the two; others are not compared.
    """
    content = _Parts(graph, [submap.grid for submap in submaps], node_points)

    def of_other_part(submap: int) -> BoolArray:
        part = int(submap_parts[submap])
        is_other: BoolArray = (
            node_parts == 1 - part if part in (0, 1) else np.zeros(len(node_parts), dtype=bool)
        )
        return is_other

    paths = path_lengths(graph.node_poses)
    pairs = compared_pairs(content, node_points, quality, paths, of_other_part)
    met = encounters(pairs, paths, content, node_points, quality)
    length = float(met.length.sum())
    contradicted = float(met.length[met.contradicts].sum())
    on_wall, on_floor = int(pairs.on_wall.sum()), int(pairs.on_floor.sum())
    check = GeometryCheck(length, contradicted, on_wall, on_floor, "")
    return check._replace(fault=_fault(check, met, join))


def _fault(check: GeometryCheck, met: Encounters, join: JoinConfig) -> str:
    """Return why parts that agree so well cannot be joined; "" if they can."""
    if check.length < join.min_overlap:
        return f"where they would overlap, scans can be compared along {check.length:.1f} m only"
    counted = max(check.on_wall + check.on_floor, 1)
    share = check.contradicted / check.length
    if share > join.max_contradicted_share:
        return (
            f"the walls contradict each other: the scans of {share:.0%} of the "
            f"{check.length:.0f} m that would overlap pass through walls of the other, or fit to "
            "them displaced"
        )
    if check.on_floor / counted > join.max_floor_share:
        return (
            f"{check.on_floor / counted:.0%} of the returns lie on floor of the other part, which "
            "its scans saw free"
        )
    return ""
