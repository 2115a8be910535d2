# SPDX-License-Identifier: Apache-2.0
"""Sparse pose adjustment as plainly as it can be written: dense, with numeric derivatives."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph


def residual(pose_a, pose_b, measured):
    """Return e of eq. (5), with b as seen from a."""
    cos, sin = math.cos(pose_a[2]), math.sin(pose_a[2])
    inverse_rotation = np.array([[cos, sin], [-sin, cos]])
    seen = inverse_rotation @ (np.asarray(pose_b[:2]) - np.asarray(pose_a[:2]))
    turn = measured[2] - (pose_b[2] - pose_a[2])
    turn = math.atan2(math.sin(turn), math.cos(turn))
    return np.array([measured[0] - seen[0], measured[1] - seen[1], turn])


def rho(loss, scale, squared):
    """Return the loss at E^2."""
    phi = scale**2
    if loss == "huber":
        return squared if squared <= phi else 2.0 * scale * math.sqrt(squared) - phi
    if loss == "cauchy":
        return phi * math.log(1.0 + squared / phi)
    if loss == "dynamic_covariance_scaling":
        return squared if squared <= phi else phi * (3.0 * squared - phi) / (phi + squared)
    if loss == "truncated":
        return min(squared, phi)
    return squared


def squared_residuals(graph: PoseGraph, poses):
    """Return E^2 of every constraint; poses of the submaps, then of the nodes."""
    m = graph.num_submaps
    result = []
    for i in range(graph.num_constraints):
        a = graph.index_a[i] + (m if graph.kinds[i] == ConstraintKind.NODE_TO_NODE else 0)
        e = residual(poses[a], poses[m + graph.index_b[i]], graph.relative_poses[i])
        result.append(e @ graph.informations[i] @ e)
    return np.array(result)


def cost(graph: PoseGraph, poses, loss="none", scale=1.0):
    """Return half the sum of rho(E^2); the loss acts on loop closures."""
    squared = squared_residuals(graph, poses)
    return 0.5 * sum(
        rho(loss if kind == ConstraintKind.LOOP_CLOSURE else "none", scale, s)
        for kind, s in zip(graph.kinds, squared, strict=True)
    )


def residual_jacobians(pose_a, pose_b, measured, step=1e-6):
    """Return de/da and de/db by central differences."""
    jacobians = []
    for which in range(2):
        columns = []
        for k in range(3):
            moved = [[np.array(pose_a, float), np.array(pose_b, float)] for _ in range(2)]
            moved[0][which][k] += step
            moved[1][which][k] -= step
            columns.append(
                (residual(*moved[0], measured) - residual(*moved[1], measured)) / (2.0 * step)
            )
        jacobians.append(np.column_stack(columns))
    return jacobians


def adjust(graph: PoseGraph, held, loss="none", scale=1.0, max_iterations=200):
    """Return the poses (submaps, then nodes) that minimise the cost, and the cost.

    Iteratively reweighted least squares on the dense normal equations, with damping.
    """
    m = graph.num_submaps
    poses = np.concatenate((graph.submap_poses, graph.node_poses))
    free = [v for v in range(len(poses)) if v not in held]
    column = {v: 3 * i for i, v in enumerate(free)}
    lowest = cost(graph, poses, loss, scale)
    damping = 0.0
    for _ in range(max_iterations):
        hessian = np.zeros((3 * len(free), 3 * len(free)))
        gradient = np.zeros(3 * len(free))
        for i in range(graph.num_constraints):
            a = graph.index_a[i] + (m if graph.kinds[i] == ConstraintKind.NODE_TO_NODE else 0)
            b = m + graph.index_b[i]
            e = residual(poses[a], poses[b], graph.relative_poses[i])
            squared = e @ graph.informations[i] @ e
            acting = loss if graph.kinds[i] == ConstraintKind.LOOP_CLOSURE else "none"
            step = 1e-6 * (1.0 + squared)
            weight = (rho(acting, scale, squared + step) - rho(acting, scale, squared)) / step
            information = weight * graph.informations[i]
            ends = dict(
                zip(
                    (a, b),
                    residual_jacobians(poses[a], poses[b], graph.relative_poses[i]),
                    strict=True,
                )
            )
            for v, jacobian in ends.items():
                if v not in column:
                    continue
                gradient[column[v] : column[v] + 3] += jacobian.T @ information @ e
                for w, other in ends.items():
                    if w in column:
                        hessian[column[v] : column[v] + 3, column[w] : column[w] + 3] += (
                            jacobian.T @ information @ other
                        )
        damped = hessian + damping * np.diag(np.diag(hessian))
        delta = np.linalg.lstsq(damped, -gradient, rcond=None)[0]
        trial = poses.copy()
        for v in free:
            trial[v] += delta[column[v] : column[v] + 3]
        trial_cost = cost(graph, trial, loss, scale)
        if trial_cost < lowest:
            done = lowest - trial_cost <= 1e-13 * lowest
            poses, lowest = trial, trial_cost
            damping *= 0.1
            if done:
                break
        else:
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e6:
                break
    return poses, lowest
