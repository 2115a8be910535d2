# SPDX-License-Identifier: Apache-2.0
"""Pose graphs of a simulated walk, with known true poses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles

INFORMATION = np.diag([500.0, 500.0, 1600.0])


class Walk(NamedTuple):
    """A graph, and the true poses of its submaps and nodes."""

    graph: PoseGraph
    submaps: np.ndarray
    nodes: np.ndarray


def walk(
    num_nodes=60,
    num_submaps=6,
    num_closures=20,
    *,
    seed=0,
    noise=(0.01, 0.002),
    drift=(0.05, 0.004),
    num_false=0,
    num_odometry=0,
    information=INFORMATION,
):
    """Return the graph of a walk: each node in two submaps, closures, then false ones, odometry.

    The start drifts by a random walk of `drift` [m, rad] a submap; measurements have `noise`.
    """
    rng = np.random.default_rng(seed)
    headings = np.cumsum(rng.normal(0.0, 0.15, num_nodes))
    steps = 0.3 * np.column_stack((np.cos(headings), np.sin(headings)))
    nodes = np.column_stack((np.cumsum(steps, axis=0), wrap_angles(headings)))
    of_node = np.arange(num_nodes) * num_submaps // num_nodes
    submaps = nodes[np.searchsorted(of_node, np.arange(num_submaps))]

    second = np.flatnonzero(of_node > 0)
    a = np.concatenate((of_node, of_node[second] - 1, rng.integers(num_submaps, size=num_closures)))
    b = np.concatenate((np.arange(num_nodes), second, rng.integers(num_nodes, size=num_closures)))
    kinds = np.full(a.size, ConstraintKind.INTRA_SUBMAP)
    kinds[a.size - num_closures :] = ConstraintKind.LOOP_CLOSURE
    measured = relative_all(submaps[a], nodes[b])
    measured[:, :2] += rng.normal(0.0, noise[0], (a.size, 2))
    measured[:, 2] += rng.normal(0.0, noise[1], a.size)
    false = slice(a.size - num_closures, a.size - num_closures + num_false)
    measured[false, 0] += rng.choice((-1.0, 1.0), num_false) * rng.uniform(1.0, 4.0, num_false)

    offsets = rng.normal(0.0, (drift[0], drift[0], drift[1]), (num_submaps, 3))
    drifted = submaps.copy()
    for s in range(1, num_submaps):
        seen = relative_all(submaps[s - 1], submaps[s]) + offsets[s]
        drifted[s] = compose_all(drifted[s - 1], seen)[0]
    graph = PoseGraph()
    graph.add_submaps(drifted)
    graph.add_nodes(compose_all(drifted[of_node], relative_all(submaps[of_node], nodes)))
    information = np.asarray(information, dtype=float)
    graph.add_constraints(kinds, a, b, measured, np.tile(information, (a.size, 1, 1)))
    for first in rng.permutation(num_nodes - 1)[:num_odometry]:
        graph.add_constraint(
            ConstraintKind.NODE_TO_NODE,
            first,
            first + 1,
            relative_all(nodes[first], nodes[first + 1])[0] + rng.normal(0.0, 0.02, 3),
            0.1 * information,
        )
    return Walk(graph, submaps, nodes)


def all_poses(graph):
    """Return the poses of the submaps, then of the nodes."""
    return np.concatenate((graph.submap_poses, graph.node_poses))
