# SPDX-License-Identifier: Apache-2.0
"""A small run made by hand, whose every closure is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.sensor.pose import Pose, compose, relative, relative_all
from tests.global_slam import closures
from tests.map_output.small_result import small_result

NODE_POSES = np.array([(0, 0, 0), (4, 0, 0.5), (8, 0, 1.5), (8, 4, 3), (4, 4, -3), (0.2, 0.1, 0.1)])
SUBMAP_POSES = np.array([(0, 0, 0), (8, 0, 1.0), (4, 4, -3.0)])
OWN = ((0, 0), (0, 1), (1, 1), (1, 2), (1, 3), (2, 3), (2, 4), (2, 5))
STAMPS = 100.0 + np.arange(6)


def closure(submap, node, dx=0.0, dtheta_deg=0.0, score=0.7):
    """A closure that disagrees with the poses of the graph by an offset."""
    seen = relative(Pose(*SUBMAP_POSES[submap].tolist()), Pose(*NODE_POSES[node].tolist()))
    moved = compose(Pose(dx, 0.0, 0.0), seen)
    turned = moved._replace(theta=moved.theta + math.radians(dtheta_deg))
    return closures.closure(submap, node, turned, score=score)


def hand_made_result(final=(), found=(), rejected=()):
    graph = PoseGraph()
    graph.add_submaps(SUBMAP_POSES)
    graph.add_nodes(NODE_POSES)
    graph.fix_submap(0)
    submap, node = np.array(OWN).T
    seen = relative_all(SUBMAP_POSES[submap], NODE_POSES[node])
    kind = ConstraintKind.INTRA_SUBMAP
    graph.add_constraints(kind, submap, node, seen, [np.eye(3)] * len(OWN))
    record = closures.record(found, final, rejected)
    closures.add_to_graph(graph, record)
    result = small_result()
    return replace(
        result,
        stamps=STAMPS,
        trajectory=NODE_POSES,
        local_trajectory=NODE_POSES,
        graph=graph,
        node_scan_index=np.arange(6),
        submap_grids=result.submap_grids * 3,
        closures=record,
    )
