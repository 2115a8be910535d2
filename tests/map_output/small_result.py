# SPDX-License-Identifier: Apache-2.0
"""A result made by hand, for tests of what is done with results."""

from __future__ import annotations

import numpy as np

from cartoloop.config import Config
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.report import Report
from cartoloop.result import Result
from cartoloop.submaps.finished_grid import FinishedGrid
from tests.global_slam.closures import add_to_graph, closure, record

FILES = {
    "map.pgm",
    "map.yaml",
    "map.png",
    "trajectory.tum",
    "local_trajectory.tum",
    "graph.g2o",
    "map.cartoloop",
    "nodes.csv",
    "closures.csv",
    "config.toml",
    "report.json",
}
"""All files of a map."""


def small_result(config=None, **report):
    cells = np.full((40, 60), 3, np.uint8)
    cells[10] = 250
    graph = PoseGraph()
    graph.add_submap((0.0, 0.0, 0.0))
    graph.add_nodes([(0.5, 0.5, 0.0), (1.0, 0.5, 0.1)])
    graph.add_constraint(ConstraintKind.INTRA_SUBMAP, 0, 0, graph.node_poses[0], np.eye(3))
    closures = record(final=[closure(0, 1, graph.node_poses[1])])
    add_to_graph(graph, closures)
    trajectory = np.array([(0.5, 0.5, 0.0), (0.8, 0.5, 0.05), (1.0, 0.5, 0.1)])
    return Result(
        stamps=np.array([100.0, 100.2, 100.4]),
        trajectory=trajectory,
        local_trajectory=trajectory + 0.01,
        graph=graph,
        node_scan_index=np.array([0, 2]),
        submap_grids=[FinishedGrid(cells, 0.0, 0.0, 0.05)],
        config=config or Config(),
        report=Report(**report),
        closures=closures,
    )
