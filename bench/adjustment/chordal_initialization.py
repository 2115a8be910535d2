# SPDX-License-Identifier: Apache-2.0
"""A chordal start of a pose graph, for solvers that would not find the minimum from a worse one."""

from __future__ import annotations

from cartoloop.global_slam.pose_adjustment import graph_problem
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.pose_adjustment import Measurements, chordal_start, is_far_off


def initialize_from_constraints(graph: PoseGraph) -> None:
    """Replace the poses of a graph by estimates from its constraints, in place.

    Fixed vertices keep their poses, and so does the first vertex of each connected part without a
    fixed one. There is no robust loss: not for graphs with many false loop closures.
    """
    poses = chordal_start(graph_problem(graph))
    graph.submap_poses[:] = poses[: graph.num_submaps]
    graph.node_poses[:] = poses[graph.num_submaps : -1]


def starts_far_off(graph: PoseGraph) -> bool:
    """Return whether our solver would not trust the poses of a graph."""
    problem = graph_problem(graph)
    return is_far_off(Measurements.of(problem), problem.poses())
