# SPDX-License-Identifier: Apache-2.0
"""What two parts of a map must pass before they are joined: scans against walls, walls as such."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartoloop.arrays import IntArray
from cartoloop.config import Config
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.join_evidence import CheckGeometry, GeometryCheck
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.map_output.part_walls import Submaps, wall_faults
from cartoloop.quality.joins import check_geometry
from cartoloop.sensor.scan_points import ScanPoints


def part_check(config: Config) -> CheckGeometry:
    """Return the examination of two parts with the limits of a configuration."""
    join = config.global_slam.constraint_search.join

    def check(
        graph: PoseGraph,
        submaps: Sequence[FinishedSubmap],
        node_points: ScanPoints,
        node_parts: IntArray,
        submap_parts: IntArray,
    ) -> GeometryCheck:
        found = check_geometry(
            graph, submaps, node_points, node_parts, submap_parts, config.quality, join
        )
        if found.fault:
            return found
        parts = []
        for part in (0, 1):
            chosen = np.flatnonzero(submap_parts[: len(submaps)] == part)
            grids = [submaps[submap].grid for submap in chosen.tolist()]
            parts.append(Submaps(grids, graph.submap_poses[chosen]))
        faults = wall_faults(parts[0], parts[1], config.local_slam.submaps, join)
        if not faults:
            return found
        worst = faults[0]
        return found._replace(
            fault=f"a wall of {worst.length:.1f} m at x {worst.x:.1f}, y {worst.y:.1f} contradicts "
            f"it: the other part saw floor there, and {worst.hidden:.0f} m2 behind it"
        )

    return check
