# SPDX-License-Identifier: Apache-2.0
"""Which pairs of submap and node are due to be searched, and how well the graph knows them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
RowArray = NDArray[np.int32]

FULL_TURN = 2.0 * math.pi


class PairRule(NamedTuple):
    """Which pairs are due, by distance and number.

    Attributes
    ----------
    max_distance : pairs farther apart are not searched [m].
    max_path_length : nor pairs with a longer path between them: wide searches find these [m].
    well_constrained_length : below this path length the graph knows a pair well [m].
    every, every_well_constrained : the numbers of submap and node must add up to a multiple of
        this: of pairs that the graph knows less well, and well.
    """

    max_distance: float
    max_path_length: float
    well_constrained_length: float
    every: int
    every_well_constrained: int


class Paths(NamedTuple):
    """What path lengths are computed from.

    Attributes
    ----------
    travelled : float64, shape (n,), path length of the robot at each node [m].
    node_submaps : int64, shape (n, 2), the first and the last submap that each was inserted into.
    submap_travelled : float64, shape (m,), path length when each submap was begun [m].
    closures : int64, shape (2, k), the nodes that closed loops, ascending, and the submaps that
        they were found in.
    closure_length : a loop closure is as uncertain as this path length [m].
    """

    travelled: FloatArray
    node_submaps: IntArray
    submap_travelled: FloatArray
    closures: IntArray
    closure_length: float


class NodePlace(NamedTuple):
    """One node, and the submap that it is best constrained to.

    Attributes
    ----------
    node : its index.
    x, y, theta : tf_map_node [m, m, rad].
    travelled : path length of the robot there [m].
    first_submap, last_submap : that it was inserted into.
    anchor, anchor_length : see :func:`nearest_anchor`.
    """

    node: int
    x: float
    y: float
    theta: float
    travelled: float
    first_submap: int
    last_submap: int
    anchor: int
    anchor_length: float


@kernel
def nearest_anchor(
    node: int,
    travelled: FloatArray,
    node_submaps: IntArray,
    submap_travelled: FloatArray,
    closures: IntArray,
    closure_length: float,
) -> tuple[int, float]:
    """Return the submap that a node is best constrained to, and the path length to it [m].

    That is the first one that it was inserted into, or along the robot's path the nearest node
    before or after that closed a loop, and from there the submap that this one was found in.

    Parameters
    ----------
    travelled, node_submaps, submap_travelled, closures, closure_length : see :class:`Paths`.
    """
    anchor = node_submaps[node, 0]
    length = abs(travelled[node] - submap_travelled[anchor])
    # By hand: np.searchsorted makes a kernel slow to load from the cache.
    low, after = 0, closures.shape[1]
    while low < after:
        middle = (low + after) // 2
        if closures[0, middle] < node:
            low = middle + 1
        else:
            after = middle
    for closure in (after - 1, after):
        if 0 <= closure < closures.shape[1]:
            step = abs(travelled[node] - travelled[closures[0, closure]]) + closure_length
            if step < length:
                anchor, length = closures[1, closure], step
    return anchor, length


@kernel
def is_due(submap: int, node: int, path_length: float, rule: PairRule) -> bool:
    """Return whether a pair is due, given the length of the shortest known path between them."""
    if path_length >= rule.max_path_length:
        return False
    if path_length < rule.well_constrained_length:
        return (submap + node) % rule.every_well_constrained == 0
    return (submap + node) % rule.every == 0


@kernel
def may_be_due(submap: int, node: int, rule: PairRule) -> bool:
    """Return whether a pair is due at any path length."""
    number = submap + node
    return number % rule.every == 0 or number % rule.every_well_constrained == 0


@kernel
def write_relative_pose(
    tf_map_submap: FloatArray, dx: float, dy: float, theta: float, out_pose: FloatArray
) -> None:
    """Write tf_submap_node.

    Parameters
    ----------
    tf_map_submap : float64, shape (3,).
    dx, dy : from the submap's origin to the node, map axes [m].
    theta : of the node [rad].
    out_pose : float64, shape (3,).
    """
    cos, sin = math.cos(tf_map_submap[2]), math.sin(tf_map_submap[2])
    out_pose[0] = cos * dx + sin * dy
    out_pose[1] = cos * dy - sin * dx
    turn = theta - tf_map_submap[2]
    out_pose[2] = turn - FULL_TURN * np.rint(turn / FULL_TURN)


@kernel
def pairs_of_node(
    place: tuple[int, float, float, float, float, int, int, int, float],
    num_submaps: int,
    submap_poses: FloatArray,
    submap_travelled: FloatArray,
    known_lengths: FloatArray,
    rule: tuple[float, float, float, int, int],
    out_submaps: RowArray,
    out_lengths: FloatArray,
    out_poses: FloatArray,
) -> int:
    """Select the submaps to search for a node.

    Python calls it for each node, so `place` and `rule` are plain tuples.

    Parameters
    ----------
    place : the node, fields of a :class:`NodePlace`.
    num_submaps : the first submaps, which are finished.
    submap_poses : float64, shape (m, 3) [m, m, rad].
    submap_travelled : see :class:`Paths`.
    known_lengths : float64, shape (k,), of the shortest known paths from the node's anchor to the
        first k submaps [m].
    rule : fields of a :class:`PairRule`.
    out_submaps : int32, shape (num_submaps,).
    out_lengths : float64, shape (num_submaps,), the shortest known path between the two [m].
    out_poses : float64, shape (num_submaps, 3), tf_submap_node.

    Returns
    -------
    how many pairs are due, submaps ascending.
    """
    node, x, y, theta, travelled, first, last, anchor, anchor_length = place
    due = PairRule(rule[0], rule[1], rule[2], rule[3], rule[4])
    num_due, num_known = 0, known_lengths.shape[0]
    for submap in range(num_submaps):
        if not may_be_due(submap, node, due):
            continue
        dx, dy = x - submap_poses[submap, 0], y - submap_poses[submap, 1]
        if dx * dx + dy * dy > due.max_distance**2:
            continue
        if first == submap or last == submap:
            continue
        length = abs(travelled - submap_travelled[submap])
        if submap < num_known and anchor < num_known:
            length = min(length, known_lengths[submap] + anchor_length)
        if is_due(submap, node, length, due):
            out_submaps[num_due], out_lengths[num_due] = submap, length
            write_relative_pose(submap_poses[submap], dx, dy, theta, out_poses[num_due])
            num_due += 1
    return num_due


@kernel
def pairs_of_submap(
    submap: int,
    tf_map_submap: FloatArray,
    node_poses: FloatArray,
    is_searchable: NDArray[np.bool_],
    paths: Paths,
    known_lengths: FloatArray,
    rule: PairRule,
    out_nodes: RowArray,
    out_lengths: FloatArray,
    out_poses: FloatArray,
) -> int:
    """Select the nodes to search in a submap.

    Parameters
    ----------
    submap : its index.
    tf_map_submap : float64, shape (3,) [m, m, rad].
    node_poses : float64, shape (n, 3), of all nodes.
    is_searchable : bool, shape (n,), the nodes with returns enough.
    paths : see :class:`Paths`.
    known_lengths : float64, shape (k,), of the shortest known paths from the submap to the first k
        submaps [m]; empty where the submap is not among them.
    rule : see :class:`PairRule`.
    out_nodes : int32, shape (n,).
    out_lengths : float64, shape (n,), the shortest known path between the two [m].
    out_poses : float64, shape (n, 3), tf_submap_node.

    Returns
    -------
    how many pairs are due, nodes ascending.
    """
    num_due, num_known = 0, known_lengths.shape[0]
    for node in range(node_poses.shape[0]):
        if not (may_be_due(submap, node, rule) and is_searchable[node]):
            continue
        dx = node_poses[node, 0] - tf_map_submap[0]
        dy = node_poses[node, 1] - tf_map_submap[1]
        if dx * dx + dy * dy > rule.max_distance**2:
            continue
        if paths.node_submaps[node, 0] == submap or paths.node_submaps[node, 1] == submap:
            continue
        anchor, anchor_length = nearest_anchor(
            node,
            paths.travelled,
            paths.node_submaps,
            paths.submap_travelled,
            paths.closures,
            paths.closure_length,
        )
        length = abs(paths.travelled[node] - paths.submap_travelled[submap])
        if submap < num_known and anchor < num_known:
            length = min(length, known_lengths[anchor] + anchor_length)
        if is_due(submap, node, length, rule):
            out_nodes[num_due], out_lengths[num_due] = node, length
            write_relative_pose(tf_map_submap, dx, dy, node_poses[node, 2], out_poses[num_due])
            num_due += 1
    return num_due
