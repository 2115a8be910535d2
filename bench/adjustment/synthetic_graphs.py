# SPDX-License-Identifier: Apache-2.0
"""Pose graphs of any size with known truth: a walk through the corridors of a large building.

The building is a square lattice of corridors whose area grows with the length of the walk, as in
the paper's museum (section VI-A: 2,253 m of walking on 22,000 m^2); the walker prefers the
corridors visited least. Each node is in two submaps, and loop closures connect nodes to other
submaps near them, so the graph is as sparse and as local as that of a mapped building.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.errors import InputError
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles

_STEP_M = 0.2
"""Distance between nodes [m]."""
_CORRIDOR_M = 15.0
"""Length of a corridor between crossings [m]."""
_FLOOR_OF_PATH_M = 22_000.0 / 2_253.0
"""Floor area per length of the path in the paper's museum [m]."""
_ASIDE_M = 0.4
"""Standard deviation of the positions at which the walker passes a crossing [m]."""
_CORNER_M = 1.0
"""Length over which corners are smoothed [m]."""
_CLOSURE_REACH_M = 8.0
"""Largest distance of a loop closure from the submap's centre, unless there are too few [m]."""

NOISE = (0.01, 0.002)
"""Standard deviations of the measurements [m, rad]."""
DRIFT = (0.05, 0.004)
"""Standard deviations of the start's drift from submap to submap [m, rad]."""
INFORMATION = (500.0, 1600.0)
"""Of every constraint [1/m^2, 1/rad^2], as the mapper sets it, not from the noise."""


class SyntheticGraph(NamedTuple):
    """A graph that starts with drift, and the true poses.

    Attributes
    ----------
    graph : submaps, nodes and constraints; the first submap is at its true pose.
    submaps : true poses, shape (num_submaps, 3) [m, m, rad].
    nodes : true poses, shape (num_nodes, 3) [m, m, rad].
    """

    graph: PoseGraph
    submaps: FloatArray
    nodes: FloatArray


def bipartite_graph(
    num_nodes: int,
    num_submaps: int,
    num_edges: int,
    seed: int = 0,
    *,
    noise: tuple[float, float] = NOISE,
    drift: tuple[float, float] = DRIFT,
    information: tuple[float, float] = INFORMATION,
) -> SyntheticGraph:
    """Return the graph of a walk with revisits; the same arguments give the same bytes.

    Parameters
    ----------
    num_nodes : one every 0.2 m.
    num_submaps : each begins at a node, and holds the nodes up to the start of the next but one.
    num_edges : constraints: two for each node (one in the first submap), the rest loop closures.
    seed : of the walk, of the choice of closures, and of the noise.
    noise : standard deviations of the measurements [m, rad].
    drift : standard deviations of the start's random walk, a submap [m, rad].
    information : of translation and rotation, every constraint's [1/m^2, 1/rad^2].

    Raises
    ------
    InputError
        If there are fewer nodes than submaps, fewer edges than nodes in submaps, or more closures
        asked for than pairs of a node and a submap exist.
    """
    if not 1 <= num_submaps <= num_nodes:
        raise InputError(f"{num_submaps} submaps of {num_nodes} nodes: give at least a node each")
    rng = np.random.default_rng(seed)
    nodes = _walk(num_nodes, rng)
    of_node = np.arange(num_nodes, dtype=np.int64) * num_submaps // num_nodes
    begin = np.searchsorted(of_node, np.arange(num_submaps))
    submaps = nodes[begin]
    second = np.flatnonzero(of_node > 0)
    num_closures = num_edges - num_nodes - second.size
    if num_closures < 0:
        raise InputError(
            f"{num_edges} edges for {num_nodes} nodes in {num_submaps} submaps: "
            f"give at least {num_nodes + second.size}"
        )
    centres = nodes[np.append(begin[1:], num_nodes - 1)]  # a submap continues into the next
    closing_node, closed_submap = _closures(nodes, of_node, centres, num_closures, rng)
    a = np.concatenate((of_node, of_node[second] - 1, closed_submap))
    b = np.concatenate((np.arange(num_nodes), second, closing_node))
    kinds = np.full(num_edges, ConstraintKind.INTRA_SUBMAP, dtype=np.int64)
    kinds[num_edges - num_closures :] = ConstraintKind.LOOP_CLOSURE
    measured = relative_all(submaps[a], nodes[b])
    measured += rng.normal(0.0, (noise[0], noise[0], noise[1]), (num_edges, 3))
    measured[:, 2] = wrap_angles(measured[:, 2])

    drifted = _drifted(submaps, drift, rng)
    graph = PoseGraph()
    graph.add_submaps(drifted)
    graph.add_nodes(compose_all(drifted[of_node], relative_all(submaps[of_node], nodes)))
    matrix = np.diag((information[0], information[0], information[1]))
    graph.add_constraints(kinds, a, b, measured, np.tile(matrix, (num_edges, 1, 1)))
    return SyntheticGraph(graph, submaps, nodes)


def _walk(num_nodes: int, rng: np.random.Generator) -> FloatArray:
    """Return poses along a walk, shape (num_nodes, 3): x along the path, corners smoothed."""
    length = _STEP_M * num_nodes
    side = max(2, round(math.sqrt(_FLOOR_OF_PATH_M * length) / _CORRIDOR_M))
    crossings = _visited_crossings(side, 2 + math.ceil(1.2 * length / _CORRIDOR_M), rng)
    corners = _CORRIDOR_M * crossings + rng.normal(0.0, _ASIDE_M, crossings.shape)
    travelled = np.append(0.0, np.cumsum(np.hypot(*np.diff(corners, axis=0).T)))
    width = round(_CORNER_M / _STEP_M)
    at = _STEP_M * np.arange(num_nodes + width)
    mean = np.full(width, 1.0 / width)
    x, y = (np.convolve(np.interp(at, travelled, axis), mean, "valid") for axis in corners.T)
    headings = np.arctan2(np.diff(y), np.diff(x)) + rng.normal(0.0, 0.02, num_nodes)
    return np.column_stack((x[:num_nodes], y[:num_nodes], wrap_angles(headings)))


def _visited_crossings(side: int, count: int, rng: np.random.Generator) -> FloatArray:
    """Return crossings of a lattice of (side + 1)^2 in walking order, shape (count, 2)."""
    passed: dict[tuple[int, int, int, int], int] = {}
    here, previous = (side // 2, side // 2), (-1, -1)
    visited = [here]
    while len(visited) < count:
        x, y = here
        neighbours = [
            to
            for to in ((x + 1, y), (x, y + 1), (x - 1, y), (x, y - 1))
            if 0 <= to[0] <= side and 0 <= to[1] <= side and to != previous
        ]
        shuffled = [neighbours[index] for index in rng.permutation(len(neighbours))]
        to = min(shuffled, key=lambda to: passed.get((*min(here, to), *max(here, to)), 0))
        street = (*min(here, to), *max(here, to))
        passed[street] = passed.get(street, 0) + 1
        previous, here = here, to
        visited.append(here)
    return np.array(visited, dtype=np.float64)


def _closures(
    nodes: FloatArray,
    of_node: IntArray,
    centres: FloatArray,
    count: int,
    rng: np.random.Generator,
) -> tuple[IntArray, IntArray]:
    """Return nodes and submaps, each of shape (count,), that are near but not in sequence."""
    reach = _CLOSURE_REACH_M
    extent = float(np.hypot(*np.ptp(nodes[:, :2], axis=0)))
    tree, centre_tree = cKDTree(nodes[:, :2]), cKDTree(centres[:, :2])
    while True:
        pairs = tree.sparse_distance_matrix(centre_tree, reach, output_type="ndarray")
        node, submap = pairs["i"].astype(np.int64), pairs["j"].astype(np.int64)
        apart = np.abs(of_node[node] - submap) > 1
        if np.count_nonzero(apart) >= count:
            break
        if reach > extent:
            raise InputError(
                f"{count} loop closures asked for, {np.count_nonzero(apart)} are possible: "
                "give fewer edges, or more nodes and submaps"
            )
        reach *= 2.0
    node, submap = node[apart], submap[apart]
    order = np.lexsort((submap, node))
    chosen = order[np.sort(rng.choice(order.size, count, replace=False))]
    return node[chosen], submap[chosen]


def _drifted(
    submaps: FloatArray, drift: tuple[float, float], rng: np.random.Generator
) -> FloatArray:
    """Return the poses of submaps that are each placed by the one before, with an error."""
    steps = relative_all(submaps[:-1], submaps[1:])
    steps += rng.normal(0.0, (drift[0], drift[0], drift[1]), steps.shape)
    headings = submaps[0, 2] + np.append(0.0, np.cumsum(steps[:, 2]))
    turned = compose_all(np.column_stack((np.zeros((headings.size - 1, 2)), headings[:-1])), steps)
    positions = submaps[0, :2] + np.vstack((np.zeros(2), np.cumsum(turned[:, :2], axis=0)))
    return np.column_stack((positions, wrap_angles(headings)))
