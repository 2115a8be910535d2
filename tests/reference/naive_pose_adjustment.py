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
    if loss in ("graduated_non_convexity", "truncated"):
        return min(squared, phi)
    return squared


def measurements(graph: PoseGraph, points=None, losses=None):
    """Return (vertex a, vertex b, tf_a_b, information, loss, scale) of everything measured.

    Vertices are submaps, nodes, the map frame; `losses` are pairs of loss and scale by kind.
    """
    m = graph.num_submaps
    losses = losses or [("none", 1.0)] * len(ConstraintKind)
    result = []
    for i in range(graph.num_constraints):
        kind = graph.kinds[i]
        a = graph.index_a[i] + (m if kind == ConstraintKind.NODE_TO_NODE else 0)
        b = m + graph.index_b[i]
        result.append((a, b, graph.relative_poses[i], graph.informations[i], *losses[kind]))
    if points is not None:
        frame = m + graph.num_nodes
        for group, node, pose, information in zip(*points, strict=True):
            result.append((frame, m + node, pose, information, *losses[group]))
    return result


def squared_residuals(measured, poses):
    """Return E^2 of every measurement; poses of the submaps, then of the nodes."""
    poses = [*poses, np.zeros(3)]
    result = []
    for a, b, relative, information, _, _ in measured:
        e = residual(poses[a], poses[b], relative)
        result.append(e @ information @ e)
    return np.array(result)


def cost_of(measured, poses):
    """Return half the sum of rho(E^2)."""
    squared = squared_residuals(measured, poses)
    return 0.5 * sum(
        rho(loss, scale, s) for (*_, loss, scale), s in zip(measured, squared, strict=True)
    )


def closure_loss(loss, scale):
    """Return the losses by kind of a loss that acts on loop closures alone."""
    return [
        (loss, scale) if kind == ConstraintKind.LOOP_CLOSURE else ("none", 1.0)
        for kind in ConstraintKind
    ]


def cost(graph: PoseGraph, poses, loss="none", scale=1.0):
    """Return half the sum of rho(E^2); the loss acts on loop closures."""
    return cost_of(measurements(graph, None, closure_loss(loss, scale)), poses)


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


def adjust(graph: PoseGraph, held, loss="none", scale=1.0):
    """Return the poses (submaps, then nodes) that minimise the cost, and the cost."""
    return minimize(graph, held, measurements(graph, None, closure_loss(loss, scale)))


def normal_equations(measured, poses, column):
    """Return the dense Hessian and gradient for the vertices that have a column."""
    poses = [*poses, np.zeros(3)]
    hessian = np.zeros((3 * len(column), 3 * len(column)))
    gradient = np.zeros(3 * len(column))
    for a, b, relative, information, loss, scale in measured:
        e = residual(poses[a], poses[b], relative)
        squared = e @ information @ e
        step = 1e-6 * (1.0 + squared)
        weight = (rho(loss, scale, squared + step) - rho(loss, scale, squared)) / step
        jacobians = residual_jacobians(poses[a], poses[b], relative)
        ends = [(v, j) for v, j in zip((a, b), jacobians, strict=True) if v in column]
        for v, jacobian in ends:
            rows = slice(column[v], column[v] + 3)
            gradient[rows] += weight * jacobian.T @ information @ e
            for w, other in ends:
                columns = slice(column[w], column[w] + 3)
                hessian[rows, columns] += weight * jacobian.T @ information @ other
    return hessian, gradient


def minimize(graph: PoseGraph, held, measured, max_iterations=200):
    """Return the poses (submaps, then nodes) that minimise the cost, and the cost.

    Iteratively reweighted least squares on the dense normal equations, with damping.
    """
    poses = np.concatenate((graph.submap_poses, graph.node_poses))
    free = [v for v in range(len(poses)) if v not in held]
    column = {v: 3 * i for i, v in enumerate(free)}
    lowest = cost_of(measured, poses)
    damping = 0.0
    for _ in range(max_iterations):
        hessian, gradient = normal_equations(measured, poses, column)
        damped = hessian + damping * np.diag(np.diag(hessian))
        delta = np.linalg.lstsq(damped, -gradient, rcond=None)[0]
        trial = poses.copy()
        for v in free:
            trial[v] += delta[column[v] : column[v] + 3]
        trial_cost = cost_of(measured, trial)
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
