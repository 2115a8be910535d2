# SPDX-License-Identifier: Apache-2.0
"""Which pairs are due to be searched, one by one, in plain words."""

from __future__ import annotations

import numpy as np

from cartoloop.sensor.pose import Pose, relative


def naive_anchor(node, paths):
    """The submap that a node is best constrained to, and the path length to it."""
    travelled, node_submaps, submap_travelled, closures, closure_length = paths
    own = node_submaps[node, 0]
    candidates = [(abs(travelled[node] - submap_travelled[own]), 0, own)]
    closed = [(other, submap) for other, submap in closures.T.tolist()]
    before = [pair for pair in closed if pair[0] < node][-1:]
    after = [pair for pair in closed if pair[0] >= node][:1]
    for preference, (other, submap) in enumerate(before + after, start=1):
        length = abs(travelled[node] - travelled[other]) + closure_length
        candidates.append((length, preference, submap))
    length, _, submap = min(candidates)
    return submap, length


def naive_pair(submap, node, submap_poses, node_poses, paths, known_length, rule):
    """Row of (submap, node, path length, tf_submap_node), or None where it is not due.

    known_length : from the node's anchor to the submap, None where it is not known.
    """
    tf_map_submap, tf_map_node = Pose(*submap_poses[submap]), Pose(*node_poses[node])
    apart = np.hypot(tf_map_node.x - tf_map_submap.x, tf_map_node.y - tf_map_submap.y)
    if apart > rule.max_distance or submap in paths.node_submaps[node]:
        return None
    length = abs(paths.travelled[node] - paths.submap_travelled[submap])
    if known_length is not None:
        length = min(length, known_length + naive_anchor(node, paths)[1])
    if length >= rule.max_path_length:
        return None
    is_known_well = length < rule.well_constrained_length
    if (submap + node) % (rule.every_well_constrained if is_known_well else rule.every) != 0:
        return None
    return (submap, node, length, *relative(tf_map_submap, tf_map_node))
