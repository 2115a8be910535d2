# SPDX-License-Identifier: Apache-2.0
"""What mapping yields: poses, pose graph, submaps, and how they came about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cartoloop.config import Config
from cartoloop.global_slam.closures import Closures
from cartoloop.map_output.report import Report

if TYPE_CHECKING:
    from cartoloop.global_slam.pose_graph import PoseGraph
    from cartoloop.map_output.occupancy_map import OccupancyMap
    from cartoloop.submaps.finished_grid import FinishedGrid


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """A finished map, or a growing one as it stands.

    Attributes
    ----------
    stamps : float64 (n,), as recorded, in file order, one for each scan that got a pose [s].
    trajectory : float64 (n, 3), ``tf_map_tracking`` of each scan, optimised [m, m, rad].
    local_trajectory : float64 (n, 3), ``tf_local_tracking``, before loop closure.
    graph : poses of nodes and submaps, and the constraints between them.
    node_scan_index : int64 (k,), which of the n scans each node is.
    submap_grids : one for each submap of the graph, in its order.
    config : the parameters used.
    report : what happened.
    closures : the record of all pairs of submap and node that were searched or matched.
    node_points : of each node the returns that searches match [m], tracking frame.
    """

    stamps: NDArray[np.float64]
    trajectory: NDArray[np.float64]
    local_trajectory: NDArray[np.float64]
    graph: PoseGraph
    node_scan_index: NDArray[np.int64]
    submap_grids: list[FinishedGrid]
    config: Config
    report: Report
    closures: Closures = field(default_factory=Closures)
    node_points: Sequence[NDArray[np.float64]] = ()

    def __repr__(self) -> str:
        counts = self.report.constraints
        return (
            f"<Result: {len(self.stamps)} scans, {self.graph.num_nodes} nodes, "
            f"{self.graph.num_submaps} submaps, {self.graph.num_loop_closures} loop closures "
            f"({counts.searched} pairs searched)>"
        )

    def occupancy_map(self) -> OccupancyMap:
        """Return the map that is exported, composed of all submaps; computed once.

        Raises
        ------
        OutputError
            The map is too large.
        """
        return self._occupancy_map

    @cached_property
    def _occupancy_map(self) -> OccupancyMap:
        from cartoloop.map_output.occupancy_map import compose_map

        return compose_map(
            self.submap_grids, self.graph.submap_poses, self.config.local_slam.submaps
        )

    def save(self, out: str | PathLike[str]) -> None:
        """Write map, trajectories, graph, configuration and report into the folder `out`.

        Raises
        ------
        OutputError
            The folder or a file in it cannot be written.
        """
        from cartoloop.map_output.save import save

        save(self, out)
