# SPDX-License-Identifier: Apache-2.0
"""A grid world: the classical test of adjustment from a bad start, a graph of nodes alone.

A robot walks along the lines of a square grid, a node each metre, and turns at random (Olson's
Manhattan world). Links measure each step, and earlier nodes near by. The start is the chain of the
measured steps, which drifts by much more than the size of the world.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.sensor.pose import relative_all, wrap_angles

NOISE = (0.05, 0.05)
"""Standard deviations of the measurements [m, rad]; their information is the inverse square."""

_BLOCK = 5
"""Steps of a metre between two crossings."""
_REACH_M = 2.0
"""Largest distance between two nodes with a link that closes a loop."""
_LINKS_PER_NODE = 0.6
"""Links that close loops, for each node."""


def grid_world(
    num_nodes: int,
    seed: int = 0,
    *,
    noise: tuple[float, float] = NOISE,
) -> tuple[PoseGraph, FloatArray]:
    """Return the graph of a walk at the chain of its steps, and the true poses.

    Parameters
    ----------
    num_nodes : one each metre.
    seed : of the walk, the noise and the choice of links.
    noise : standard deviations [m, rad].

    Returns
    -------
    graph : nodes and links (`ConstraintKind.NODE_TO_NODE`); its first node is at its true pose.
    truth : shape (num_nodes, 3) [m, m, rad].
    """
    rng = np.random.default_rng(seed)
    truth = _walk(num_nodes, rng)
    a, b = _revisits(truth, round(_LINKS_PER_NODE * num_nodes), rng)
    steps = np.arange(num_nodes - 1)
    a, b = np.concatenate((steps, a)), np.concatenate((steps + 1, b))
    sigma = np.array((noise[0], noise[0], noise[1]))
    measured = relative_all(truth[a], truth[b]) + rng.normal(0.0, sigma, (a.size, 3))
    measured[:, 2] = wrap_angles(measured[:, 2])
    graph = PoseGraph()
    graph.add_nodes(_chain(truth[0], measured[: num_nodes - 1]))
    graph.fix_node(0)
    information = np.tile(np.diag(1.0 / sigma**2), (a.size, 1, 1))
    kinds = np.full(a.size, ConstraintKind.NODE_TO_NODE, dtype=np.int64)
    graph.add_constraints(kinds, a, b, measured, information)
    return graph, truth


def _walk(num_nodes: int, rng: np.random.Generator) -> FloatArray:
    """Return poses on the grid, one each metre, shape (num_nodes, 3)."""
    half = max(_BLOCK, _BLOCK * round(math.sqrt(num_nodes / 3.0) / 2.0 / _BLOCK))
    directions = np.array(((1, 0), (0, 1), (-1, 0), (0, -1)))
    poses = np.empty((num_nodes, 3))
    at, heading = np.zeros(2, dtype=np.int64), 0
    for i in range(num_nodes):
        if (at % _BLOCK == 0).all():
            turn = int(rng.choice((0, 0, 1, -1)))
            if (np.abs(at + _BLOCK * directions[(heading + turn) % 4]) > half).any():
                turn = next(
                    t
                    for t in (1, -1, 2)
                    if (np.abs(at + _BLOCK * directions[(heading + t) % 4]) <= half).all()
                )
            heading = (heading + turn) % 4
        poses[i] = *at, heading * math.pi / 2.0
        at = at + directions[heading]
    poses[:, 2] = wrap_angles(poses[:, 2])
    return poses


def _revisits(truth: FloatArray, count: int, rng: np.random.Generator) -> tuple[IntArray, IntArray]:
    """Return earlier and later nodes near each other, but not in sequence, (count,) at most."""
    pairs = cKDTree(truth[:, :2]).query_pairs(_REACH_M, output_type="ndarray")
    pairs = pairs[pairs[:, 1] - pairs[:, 0] > 10]
    pairs = pairs[np.lexsort((pairs[:, 0], pairs[:, 1]))]
    chosen = np.sort(rng.choice(len(pairs), min(count, len(pairs)), replace=False))
    return pairs[chosen, 0].astype(np.int64), pairs[chosen, 1].astype(np.int64)


def _chain(first: FloatArray, steps: FloatArray) -> FloatArray:
    """Return the poses of steps one after the other."""
    headings = first[2] + np.append(0.0, np.cumsum(steps[:, 2]))
    cos, sin = np.cos(headings[:-1]), np.sin(headings[:-1])
    moves = np.column_stack(
        (cos * steps[:, 0] - sin * steps[:, 1], sin * steps[:, 0] + cos * steps[:, 1])
    )
    positions = first[:2] + np.vstack((np.zeros(2), np.cumsum(moves, axis=0)))
    return np.column_stack((positions, wrap_angles(headings)))
