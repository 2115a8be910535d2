# SPDX-License-Identifier: Apache-2.0
"""Which submaps later sessions drove through again, and did not only look into."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import BoolArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.session import session_numbers

MIN_REVISITED = 0.5
"""Share of the nodes of a submap that later sessions must have been near to."""


def driven_again(
    graph: PoseGraph,
    first_nodes: list[int],
    submap_sessions: IntArray,
    node_parts: IntArray,
    distance: float,
) -> BoolArray:
    """Return of each submap whether later sessions drove along its path, shape (num_submaps,).

    From afar, a few beams see much of a room, but little of it well.

    Parameters
    ----------
    graph : with adjusted poses.
    first_nodes : of each session.
    submap_sessions, node_parts : session of each submap, part of each node, by number.
    distance : up to which two nodes are at one place [m].
    """
    from scipy.spatial import cKDTree

    num_nodes = graph.num_nodes
    node_sessions = session_numbers(first_nodes, num_nodes)
    again = np.zeros(num_nodes, dtype=bool)
    for session in np.unique(node_sessions).tolist():
        for part in np.unique(node_parts).tolist():
            own = np.flatnonzero((node_sessions == session) & (node_parts == part))
            later = (node_sessions > session) & (node_parts == part)
            if len(own) and later.any():
                apart, _ = cKDTree(graph.node_poses[later, :2]).query(graph.node_poses[own, :2])
                again[own] = apart <= distance
    inside = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
    submaps, nodes = graph.index_a[inside], graph.index_b[inside]
    # A node may link sessions: in a submap, only those of its own time count.
    own = submap_sessions[submaps] == node_sessions[nodes]
    submaps, nodes = submaps[own], nodes[own]
    counts = np.bincount(submaps, minlength=graph.num_submaps)
    revisited = np.bincount(submaps, weights=again[nodes], minlength=graph.num_submaps)
    result: BoolArray = (counts > 0) & (revisited >= MIN_REVISITED * counts)
    return result
