# SPDX-License-Identifier: Apache-2.0
"""Which pairs are due to be searched, one by one and in words of one syllable."""

from __future__ import annotations

import numpy as np

from cartoloop.sensor.pose import Pose, relative


def naive_tie(node, travelled, node_submaps, submap_travelled, ties, closure_length):
    """The submap that a node is best tied to, and the way to it."""
    own = node_submaps[node, 0]
    ways = [(abs(travelled[node] - submap_travelled[own]), 0, own)]
    closed = [(other, submap) for other, submap in ties.T.tolist()]
    before = [pair for pair in closed if pair[0] < node][-1:]
    behind = [pair for pair in closed if pair[0] >= node][:1]
    for preference, (other, submap) in enumerate(before + behind, start=1):
        way = abs(travelled[node] - travelled[other]) + closure_length
        ways.append((way, preference, submap))
    way, _, submap = min(ways)
    return submap, way


def naive_due_pairs(
    submaps, nodes, submap_poses, node_poses, max_distance, is_sought, travelled, node_submaps,
    submap_travelled, ties, closure_length, known_ways, ways_from_submap, bound_length, every,
    every_bound,
):  # fmt: skip
    """Rows of (submap, node, the node's first submap, shortest way, tf_submap_node)."""
    rows = []
    for submap in submaps:
        for node in nodes:
            tf_map_submap, tf_map_node = Pose(*submap_poses[submap]), Pose(*node_poses[node])
            apart = np.hypot(tf_map_node.x - tf_map_submap.x, tf_map_node.y - tf_map_submap.y)
            if apart > max_distance or submap in node_submaps[node] or not is_sought[node]:
                continue
            length = abs(travelled[node] - submap_travelled[submap])
            tie, way = naive_tie(
                node, travelled, node_submaps, submap_travelled, ties, closure_length
            )
            if max(submap, tie) < len(known_ways):
                length = min(length, known_ways[tie if ways_from_submap else submap] + way)
            if (submap + node) % (every_bound if length < bound_length else every) == 0:
                seen = relative(tf_map_submap, tf_map_node)
                rows.append((submap, node, node_submaps[node, 0], length, *seen))
    return np.array(rows, dtype=np.float64).reshape(-1, 7)
