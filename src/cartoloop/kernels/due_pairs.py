# SPDX-License-Identifier: Apache-2.0
"""Which pairs of submap and node are due to be searched, and how well the graph knows them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FULL_TURN = 2.0 * math.pi


@kernel
def nearest_tie(
    node: int,
    travelled: FloatArray,
    node_submaps: IntArray,
    submap_travelled: FloatArray,
    ties: IntArray,
    closure_length: float,
) -> tuple[int, float]:
    """Return the submap that a node is best tied to, and how far the way to it is [m].

    That is the first one that it was inserted into, or along the robot's path the nearest node
    before or behind that closed a loop, and from there the submap that this one was found in.

    Parameters
    ----------
    travelled : float64, shape (n,), how far the robot had come at each node [m].
    node_submaps : int64, shape (n, 2), the first and the last submap that each was inserted into.
    submap_travelled : float64, shape (m,), how far it had come when each submap was begun [m].
    ties : int64, shape (2, k), the nodes that closed loops, ascending, and the submaps that they
        were found in.
    closure_length : a loop closure is as good as so much of the path [m].
    """
    tie = node_submaps[node, 0]
    way = abs(travelled[node] - submap_travelled[tie])
    # By hand: np.searchsorted makes a kernel slow to load from the cache.
    low, behind = 0, ties.shape[1]
    while low < behind:
        middle = (low + behind) // 2
        if ties[0, middle] < node:
            low = middle + 1
        else:
            behind = middle
    for closure in (behind - 1, behind):
        if 0 <= closure < ties.shape[1]:
            step = abs(travelled[node] - travelled[ties[0, closure]]) + closure_length
            if step < way:
                tie, way = ties[1, closure], step
    return tie, way


@kernel
def due_pairs(
    first_submap: int,
    end_submap: int,
    first_node: int,
    end_node: int,
    submap_poses: FloatArray,
    node_poses: FloatArray,
    max_distance: float,
    is_sought: NDArray[np.bool_],
    travelled: FloatArray,
    node_submaps: IntArray,
    submap_travelled: FloatArray,
    ties: IntArray,
    closure_length: float,
    known_ways: FloatArray,
    ways_from_submap: bool,
    bound_length: float,
    every: int,
    every_bound: int,
    out_pairs: IntArray,
    out_lengths: FloatArray,
    out_poses: FloatArray,
) -> int:
    """Write the pairs of one submap and many nodes, or many and one, that are due to be searched.

    Those are near each other, the node was not inserted into the submap, and their numbers add up
    to a multiple of `every`, or of `every_bound` where the graph knows better how they stand.

    Parameters
    ----------
    first_submap, end_submap, first_node, end_node : the submaps and nodes from the first until
        before the end; there is one submap, or one node.
    submap_poses, node_poses : float64, shapes (m, 3), (n, 3), of all [m, m, rad].
    max_distance : pairs farther apart are not searched [m].
    is_sought : bool, shape (n,), the nodes that are sought at all.
    travelled, node_submaps, submap_travelled, ties, closure_length : see
        :func:`nearest_tie`.
    known_ways : float64, shape (k,), the lengths of the shortest known ways to the first k submaps
        from the one submap, or from what the one node is tied to [m].
    ways_from_submap : which of the two it is.
    bound_length : by a shorter way than this the graph knows a pair well [m].
    every, every_bound : of pairs that it knows less well, and well, one in so many is due.
    out_pairs : int64, shape (number of pairs, 3): submap, node, and the first submap that the node
        was inserted into.
    out_lengths : float64, shape (number of pairs,), the shortest known way between the two [m].
    out_poses : float64, shape (number of pairs, 3), tf_submap_node.

    Returns
    -------
    how many pairs are due, submaps and nodes ascending.
    """
    num_due, num_known = 0, known_ways.shape[0]
    for submap in range(first_submap, end_submap):
        x, y, theta = submap_poses[submap]
        cos, sin = math.cos(theta), math.sin(theta)
        for node in range(first_node, end_node):
            number = submap + node
            if (number % every != 0 and number % every_bound != 0) or not is_sought[node]:
                continue
            dx, dy = node_poses[node, 0] - x, node_poses[node, 1] - y
            if math.hypot(dx, dy) > max_distance:
                continue
            if node_submaps[node, 0] == submap or node_submaps[node, 1] == submap:
                continue
            tie, way = nearest_tie(
                node, travelled, node_submaps, submap_travelled, ties, closure_length
            )
            length = abs(travelled[node] - submap_travelled[submap])
            if submap < num_known and tie < num_known:
                length = min(length, known_ways[tie if ways_from_submap else submap] + way)
            if number % (every_bound if length < bound_length else every) != 0:
                continue
            out_pairs[num_due, 0] = submap
            out_pairs[num_due, 1] = node
            out_pairs[num_due, 2] = node_submaps[node, 0]
            out_lengths[num_due] = length
            out_poses[num_due, 0] = cos * dx + sin * dy
            out_poses[num_due, 1] = cos * dy - sin * dx
            turn = node_poses[node, 2] - theta
            out_poses[num_due, 2] = turn - FULL_TURN * np.rint(turn / FULL_TURN)
            num_due += 1
    return num_due
