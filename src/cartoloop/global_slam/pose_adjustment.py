# SPDX-License-Identifier: Apache-2.0
"""Sparse pose adjustment: the poses that agree best with all constraints (section V-A, eq. SPA).

Levenberg-Marquardt that begins as plain Gauss-Newton, undamped, and damps only where a step fails
to lower the cost or the system cannot be factored.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.global_slam.reduced_system import ReducedSystem
from cartoloop.global_slam.robust_loss import (
    DEFAULT_SCALE,
    KERNEL_LOSS,
    Loss,
    initial_convexity,
    truncated_weights,
)
from cartoloop.kernels.pose_residuals import NO_LOSS
from cartoloop.sensor.pose import relative_all, wrap_angles

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FIRST_DAMPING = 1e-9
_GOOD_GAIN = 0.5
_MAX_DAMPING = 1e8
_DAMPING_GROWTH = 10.0
_GRADUATION = 1.4
_VANISHING_COST = 1e-20


@dataclass(frozen=True, slots=True)
class AdjustmentOptions:
    """Parameters of one adjustment.

    Attributes
    ----------
    loss : what limits the influence of single constraints.
    loss_scale : where it sets in, in units of the whitened residual E; None: the loss's default.
    robust_kinds : kinds of constraint that the loss acts on; the others are trusted.
    max_iterations : linear systems solved at the most.
    relative_tolerance : change of the cost, as a share of it, below which the result stands.
    """

    loss: Loss = Loss.HUBER
    loss_scale: float | None = None
    robust_kinds: Collection[ConstraintKind] = (ConstraintKind.LOOP_CLOSURE,)
    max_iterations: int = 50
    relative_tolerance: float = 1e-6


@dataclass(frozen=True, slots=True)
class AdjustmentResult:
    """What an adjustment did.

    Attributes
    ----------
    cost, initial_cost : half the sum of rho(E^2), after and before (eq. SPA).
    iterations : linear systems solved.
    converged : False if it stopped for want of iterations.
    weights : what the loss left of each constraint's pull, in [0, 1], shape (num_constraints,).
    """

    cost: float
    initial_cost: float
    iterations: int
    converged: bool
    weights: FloatArray


def adjust(graph: PoseGraph, options: AdjustmentOptions | None = None) -> AdjustmentResult:
    """Move the nodes and submaps of a graph to where its constraints agree best, in place.

    Fixed nodes and submaps stay. A part of the graph that is connected with none of these is held
    at its first submap (or first node); what no constraint touches stays where it is.

    Parameters
    ----------
    graph : its poses are written to; nothing else is.
    options : None for the defaults.

    Notes
    -----
    Same graph, same options, same bytes. Cost per iteration: linear in the constraints, plus the
    sparse factorization of the submaps (and of nodes tied to other nodes).
    """
    options = options or AdjustmentOptions()
    scale = DEFAULT_SCALE[options.loss] if options.loss_scale is None else options.loss_scale
    loss_of_kind = np.array(
        [
            KERNEL_LOSS[options.loss] if k in options.robust_kinds else NO_LOSS
            for k in ConstraintKind
        ],
        dtype=np.int64,
    )
    poses = np.concatenate((graph.submap_poses, graph.node_poses))
    system = ReducedSystem(graph, loss_of_kind)
    if options.loss is Loss.GRADUATED_NON_CONVEXITY:
        run = _graduate(system, poses, scale, options)
    else:
        run = _descend(system, poses, scale, options)
    poses[:, 2] = wrap_angles(poses[:, 2])
    graph.submap_poses[:] = poses[: graph.num_submaps]
    graph.node_poses[:] = poses[graph.num_submaps :]
    weights = np.empty(graph.num_constraints)
    weights[system.order] = system.weights
    return AdjustmentResult(run.cost, run.initial_cost, run.iterations, run.converged, weights)


def constraint_residuals(graph: PoseGraph) -> tuple[FloatArray, FloatArray]:
    """Return by how much each constraint is violated at the current poses.

    Returns
    -------
    translation_error : shape (num_constraints,) [m].
    rotation_error : shape (num_constraints,) [rad], not negative.

    Notes
    -----
    A loop closure counts as true where these are at most 20 cm and 1 degree (section VI, table IV).
    """
    if graph.num_constraints == 0:
        return np.zeros(0), np.zeros(0)
    between_nodes = (graph.kinds == ConstraintKind.NODE_TO_NODE)[:, np.newaxis]
    # the other sort's index may be out of range for this one: any row will do there
    from_node = graph.node_poses[np.where(between_nodes[:, 0], graph.index_a, 0)]
    if graph.num_submaps > 0:
        from_submap = graph.submap_poses[np.where(between_nodes[:, 0], 0, graph.index_a)]
        from_node = np.where(between_nodes, from_node, from_submap)
    seen = relative_all(from_node, graph.node_poses[graph.index_b])
    error = graph.relative_poses - seen
    return np.hypot(error[:, 0], error[:, 1]), np.abs(wrap_angles(error[:, 2]))


@dataclass(frozen=True, slots=True)
class _Run:
    cost: float
    initial_cost: float
    iterations: int
    converged: bool


def _descend(
    system: ReducedSystem, poses: FloatArray, scale: float, options: AdjustmentOptions
) -> _Run:
    """Lower the cost until it changes no more; writes the result into `poses`."""
    tolerance = options.relative_tolerance
    trial = poses.copy()  # vertices that are held are never written
    damping = least_damping = 0.0
    growth = _DAMPING_GROWTH
    initial_cost = cost = system.linearize(poses, scale)
    converged = cost <= _VANISHING_COST
    iterations = 0
    while not converged and iterations < options.max_iterations and damping <= _MAX_DAMPING:
        iterations += 1
        predicted, definite = system.solve() if system.reduce(damping) else (0.0, False)
        if not definite:
            damping = least_damping = max(_DAMPING_GROWTH * damping, _FIRST_DAMPING)
            continue
        system.move(poses, trial)
        trial_cost = system.linearize(trial, scale)
        if not trial_cost < cost:
            converged = predicted <= tolerance * cost
            damping = max(growth * damping, _FIRST_DAMPING)
            growth *= 2.0
            system.linearize(poses, scale)
            continue
        decrease = cost - trial_cost
        # what the model of an undamped step was wrong by is about what the next one could gain
        left = abs(decrease - predicted) if damping == 0.0 else decrease
        converged = min(decrease, left) <= tolerance * trial_cost or trial_cost <= _VANISHING_COST
        if growth == _DAMPING_GROWTH and decrease > _GOOD_GAIN * predicted:
            damping = damping / _DAMPING_GROWTH if damping > _FIRST_DAMPING else least_damping
        growth = _DAMPING_GROWTH
        poses[:] = trial
        cost = trial_cost
    return _Run(cost, initial_cost, iterations, converged)


def _graduate(
    system: ReducedSystem, poses: FloatArray, scale: float, options: AdjustmentOptions
) -> _Run:
    """Graduated non-convexity: alternate weights and poses while the loss hardens step by step."""
    initial_cost = system.linearize(poses, scale)
    losses = system.losses.copy()
    robust = losses != NO_LOSS
    system.losses[:] = NO_LOSS
    run = _descend(system, poses, scale, options)
    iterations = run.iterations
    weights = np.ones(int(robust.sum()))
    if weights.size > 0:
        mu = initial_convexity(system.squared_residuals(poses)[robust], scale)
        while np.isfinite(mu) and iterations < options.max_iterations * 10:
            system.rows[robust, -1] = 1.0
            weights = truncated_weights(system.squared_residuals(poses)[robust], scale, mu)
            system.rows[robust, -1] = weights
            run = _descend(system, poses, scale, options)
            iterations += run.iterations
            if np.all((weights == 0.0) | (weights == 1.0)):
                break
            mu *= _GRADUATION
    system.rows[robust, -1] = 1.0
    system.losses[:] = losses
    cost = system.linearize(poses, scale)
    system.weights[robust] = weights
    return _Run(cost, initial_cost, iterations, run.converged)
