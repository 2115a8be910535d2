# SPDX-License-Identifier: Apache-2.0
"""A normal distribution of poses as few constraints between pairs of them.

The pairs with the best known relative poses are constrained, such that these are as well known as
in the distribution (after Mazuran, Burgard, Tipaldi, "Nonlinear factor recovery for long-term
SLAM", 2016).
"""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.lifelong.marginal import Marginal, lever, turns
from cartoloop.sensor.pose import relative_all, wrap_angles

_LEAST_INFORMATION = 1e-3
"""Added to what is inverted: directions that nothing determines are known to 30 m."""

_LEAST_COUPLING = 1e-6
"""Blocks of a smaller norm do not connect two submaps."""

_NUM_NEIGHBOURS = 6
"""Each submap that stays is constrained to at least this many others, the best known ones."""

_NUM_FITTING_ROUNDS = 10
"""Rounds of fitting the constraints to how well relative poses are known."""


def recovered(
    marginal: Marginal, submap_poses: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the relative poses that approximate a distribution.

    Returns
    -------
    pairs : int64, shape (n, 2), of submaps.
    tf_a_b : float64, shape (n, 3), mean [m, m, rad].
    information : float64, shape (n, 3, 3), frame of a.
    """
    count = len(marginal.submaps)
    blocks = np.abs(marginal.information.reshape(count, 3, count, 3)).max(axis=(1, 3))
    pairs, poses, informations = [np.zeros((0, 2), np.int64)], [], []
    for members in _components(blocks > _LEAST_COUPLING):
        submaps = marginal.submaps[members]
        mean, known = _relative(marginal, members, submap_poses[submaps])
        edges = _best_known(np.linalg.slogdet(known)[1])
        one, other = edges.T
        fitted = fitted_informations(mean, edges, known[one, other], len(members) - 1)
        rotation = np.swapaxes(turns(mean[one, 2]), 1, 2)
        pairs.append(submaps[edges])
        poses.append(relative_all(mean[one], mean[other]))
        informations.append(rotation @ fitted @ np.swapaxes(rotation, 1, 2))
    none = np.zeros((0, 3))
    return (
        np.concatenate(pairs),
        np.concatenate([none, *poses]),
        np.concatenate([none.reshape(0, 3, 3), *informations]),
    )


def fitted_informations(
    mean: FloatArray, edges: IntArray, known: FloatArray, num_tree: int
) -> FloatArray:
    """Return information matrices of constraints with which relative poses are as well known.

    Parameters
    ----------
    mean : poses, shape (k, 3).
    edges : pairs of them that are constrained, shape (n, 2); the first `num_tree` are a tree.
    known : information of each relative pose, shape (n, 3, 3), map axes.

    Returns
    -------
    float64, shape (n, 3, 3), positive semi-definite, map axes.

    Notes
    -----
    Iterative proportional fitting: each constraint in turn gets what its relative pose lacks,
    until all of them are as well known as they should be. For a tree, `known` is the solution.
    """
    count = len(mean)
    fitted = np.zeros_like(known)
    fitted[:num_tree] = known[:num_tree]
    jacobians = np.zeros((len(edges), 3, 3 * count))
    for number, (one, other) in enumerate(edges.tolist()):
        offset = (mean[other] - mean[one])[None]
        jacobians[number, :, 3 * one : 3 * one + 3] = -lever(offset)[0]
        jacobians[number, :, 3 * other : 3 * other + 3] = np.eye(3)
    jacobians = jacobians[:, :, 3:]  # the first pose is held
    for _ in range(_NUM_FITTING_ROUNDS):
        total = np.einsum("nai,nab,nbj->ij", jacobians, fitted, jacobians)
        covariance = np.linalg.inv(total + _LEAST_INFORMATION * np.eye(len(total)))
        for number, jacobian in enumerate(jacobians):
            across = jacobian @ covariance
            present = across @ jacobian.T
            lacking = known[number] - np.linalg.inv(present)
            change = _positive(fitted[number] + lacking) - fitted[number]
            fitted[number] += change
            covariance -= across.T @ np.linalg.solve(np.eye(3) + change @ present, change) @ across
    return fitted


def _positive(information: FloatArray) -> FloatArray:
    """Return the nearest symmetric positive semi-definite matrix, shape (3, 3)."""
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    nearest: FloatArray = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return nearest


def _relative(
    marginal: Marginal, members: IntArray, poses: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the mean poses of connected submaps, and the information of all relative poses.

    Shapes (k, 3) and (k, k, 3, 3), map axes; the first submap is held.
    """
    count = len(members)
    axes = (3 * members[:, None] + np.arange(3)).ravel()[3:]
    inner = marginal.information[np.ix_(axes, axes)]
    covariance = np.zeros((3 * count, 3 * count))
    covariance[3:, 3:] = np.linalg.inv(inner + _LEAST_INFORMATION * np.eye(len(axes)))
    change = np.zeros(3 * count)
    change[3:] = -covariance[3:, 3:] @ marginal.gradient[axes]
    mean = poses + change.reshape(count, 3)
    mean[:, 2] = wrap_angles(mean[:, 2])
    blocks = np.swapaxes(covariance.reshape(count, 3, count, 3), 1, 2)
    own = blocks[np.arange(count), np.arange(count)]
    one, other = (index.ravel() for index in np.indices((count, count)))
    levers = lever(mean[other] - mean[one])
    across = levers @ blocks[one, other]
    relative = (
        own[other]
        + levers @ own[one] @ np.swapaxes(levers, 1, 2)
        - across
        - np.swapaxes(across, 1, 2)
    )
    relative[one == other] = np.eye(3)
    information = np.linalg.inv(relative)
    information = (information + np.swapaxes(information, 1, 2)) / 2
    return mean, information.reshape(count, count, 3, 3)


def _components(connected: BoolArray) -> list[IntArray]:
    """Return the members of each connected set of two or more, ascending."""
    left = np.ones(len(connected), dtype=bool)
    found = []
    for first in range(len(connected)):
        if not left[first]:
            continue
        members = np.zeros(len(connected), dtype=bool)
        members[first] = True
        while True:
            reached = members | connected[members].any(axis=0)
            if np.array_equal(reached, members):
                break
            members = reached
        left &= ~members
        if np.count_nonzero(members) > 1:
            found.append(np.flatnonzero(members))
    return found


def _best_known(weights: FloatArray) -> IntArray:
    """Return the pairs that are constrained: a spanning tree, then the best known of each.

    Parameters
    ----------
    weights : of the pairs, symmetric, shape (k, k).
    """
    tree = _spanning_tree(weights)
    others = weights.copy()
    np.fill_diagonal(others, -np.inf)
    nearest = np.argsort(-others, axis=1, kind="stable")[:, :_NUM_NEIGHBOURS]
    best = np.column_stack((np.repeat(np.arange(len(weights)), nearest.shape[1]), nearest.ravel()))
    best = best[best[:, 0] != best[:, 1]]
    chosen = {(min(pair), max(pair)) for pair in best.tolist()}
    chosen -= {(min(pair), max(pair)) for pair in tree.tolist()}
    return np.array([*tree.tolist(), *sorted(chosen)], dtype=np.int64).reshape(-1, 2)


def _spanning_tree(weights: FloatArray) -> IntArray:
    """Return the pairs of the spanning tree of the largest weights, shape (k - 1, 2)."""
    count = len(weights)
    best, nearest = weights[0].copy(), np.zeros(count, dtype=np.int64)
    outside = np.ones(count, dtype=bool)
    outside[0] = False
    edges = np.empty((count - 1, 2), dtype=np.int64)
    for number in range(count - 1):
        new = int(np.argmax(np.where(outside, best, -np.inf)))
        edges[number] = nearest[new], new
        outside[new] = False
        closer = weights[new] > best
        best[closer], nearest[closer] = weights[new][closer], new
    return edges
