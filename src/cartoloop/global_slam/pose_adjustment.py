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

from cartoloop.global_slam.packed_nodes import PackedNodes
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.global_slam.reduced_system import (
    ReducedSystem,
    constraint_ends,
    kept_nodes,
    measured_rows,
)
from cartoloop.global_slam.robust_loss import (
    DEFAULT_SCALE,
    KERNEL_LOSS,
    Loss,
    initial_convexity,
    truncated_weights,
)
from cartoloop.kernels import pose_residuals
from cartoloop.kernels.pose_residuals import GIVEN, NO_LOSS
from cartoloop.sensor.pose import wrap_angles

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FIRST_DAMPING = 1e-9
_GOOD_GAIN = 0.5
_MAX_DAMPING = 1e8
_DAMPING_GROWTH = 10.0
_GRADUATION = 1.4
_VANISHING_COST = 1e-20
_LAST_STEP = 1e-3  # predicted share of the cost, below which the step is likely to be the last


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


class PoseAdjuster:
    """Adjusts a graph again and again while it grows.

    What it has made of a constraint it keeps, so that the next run prepares only what is new.

    Parameters
    ----------
    graph : constraints may be added to it; those that it has must stay as they are.
    """

    def __init__(self, graph: PoseGraph) -> None:
        self.graph = graph
        self._packed = PackedNodes(kept_nodes(graph))

    def adjust(self, options: AdjustmentOptions | None = None) -> AdjustmentResult:
        """Move the nodes and submaps to where the constraints agree best, in place.

        Fixed nodes and submaps stay. A part of the graph that is connected with none of these is
        held at its first submap (or first node); what no constraint touches stays where it is.

        Parameters
        ----------
        options : None for the defaults.

        Notes
        -----
        Same graph, same options, same bytes, however often it was adjusted as it grew to what it is
        with the same poses. Cost per iteration: linear in the constraints, plus the sparse
        factorization of the submaps (and of nodes tied to other nodes).
        """
        graph, options = self.graph, options or AdjustmentOptions()
        scale = DEFAULT_SCALE[options.loss] if options.loss_scale is None else options.loss_scale
        loss_of_kind = np.array(
            [
                KERNEL_LOSS[options.loss] if k in options.robust_kinds else NO_LOSS
                for k in ConstraintKind
            ],
            dtype=np.int64,
        )
        kept = kept_nodes(graph)
        if not np.array_equal(kept, self._packed.kept_nodes):
            self._packed = PackedNodes(kept)
        self._packed.extend(graph)
        poses = np.concatenate((graph.submap_poses, graph.node_poses))
        system = ReducedSystem(graph, self._packed, loss_of_kind)
        if options.loss is Loss.GRADUATED_NON_CONVEXITY:
            run = _graduate(graph, system, poses, scale, options)
        else:
            run = _descend(system, poses, scale, options)
        poses[:, 2] = wrap_angles(poses[:, 2])
        graph.submap_poses[:] = poses[: graph.num_submaps]
        graph.node_poses[:] = poses[graph.num_submaps :]
        weights = system.weights(graph.num_constraints)
        return AdjustmentResult(run.cost, run.initial_cost, run.iterations, run.converged, weights)


def adjust(graph: PoseGraph, options: AdjustmentOptions | None = None) -> AdjustmentResult:
    """Adjust a graph once, in place; see :meth:`PoseAdjuster.adjust`."""
    return PoseAdjuster(graph).adjust(options)


def constraint_residuals(
    graph: PoseGraph, constraints: IntArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return by how much constraints are violated at the current poses.

    Parameters
    ----------
    constraints : which, shape (n,); None for all.

    Returns
    -------
    translation_error : shape (n,) [m].
    rotation_error : shape (n,) [rad], not negative.

    Notes
    -----
    A loop closure counts as true where these are at most 20 cm and 1 degree (section VI, table IV).
    """
    if constraints is None:
        constraints = np.arange(graph.num_constraints)
    errors = np.empty((2, constraints.size))
    pose_residuals.residual_sizes(
        constraints,
        graph.kinds == ConstraintKind.NODE_TO_NODE,
        graph.index_a,
        graph.index_b,
        graph.relative_poses,
        graph.submap_poses,
        graph.node_poses,
        errors[0],
        errors[1],
    )
    return errors[0], errors[1]


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
    initial_cost = cost = system.linearize(poses, scale, damping)
    is_ready, ready_for = True, damping  # the system is at `poses`, nodes eliminated, so damped
    converged = cost <= _VANISHING_COST
    iterations = 0
    while not converged and iterations < options.max_iterations and damping <= _MAX_DAMPING:
        iterations += 1
        if not is_ready or ready_for != damping:
            system.linearize(poses, scale, damping)
        predicted, definite = system.solve(damping)
        is_ready, ready_for = definite, damping
        if not definite:
            damping = least_damping = max(_DAMPING_GROWTH * damping, _FIRST_DAMPING)
            continue
        system.move(poses, trial)
        is_ready = predicted > _LAST_STEP * cost and iterations < options.max_iterations
        trial_cost = system.linearize(trial, scale, damping, eliminate=is_ready)
        if not trial_cost < cost:
            converged = predicted <= tolerance * cost
            damping = max(growth * damping, _FIRST_DAMPING)
            growth *= 2.0
            is_ready = False
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
    graph: PoseGraph,
    system: ReducedSystem,
    poses: FloatArray,
    scale: float,
    options: AdjustmentOptions,
) -> _Run:
    """Graduated non-convexity: alternate weights and poses while the loss hardens step by step."""
    initial_cost = system.linearize(poses, scale, eliminate=False)
    losses = system.loss_of_kind.copy()
    robust = (losses != NO_LOSS)[graph.kinds]
    system.loss_of_kind[losses != NO_LOSS] = GIVEN
    weights = np.ones(graph.num_constraints)
    system.set_weights(weights)
    run = _descend(system, poses, scale, options)
    iterations = run.iterations
    if robust.any():
        mu = initial_convexity(_squared_residuals(graph, poses)[robust], scale)
        while np.isfinite(mu) and iterations < options.max_iterations * 10:
            squared = _squared_residuals(graph, poses)[robust]
            weights[robust] = truncated_weights(squared, scale, mu)
            system.set_weights(weights)
            run = _descend(system, poses, scale, options)
            iterations += run.iterations
            if np.all((weights == 0.0) | (weights == 1.0)):
                break
            mu *= _GRADUATION
    system.loss_of_kind[:] = losses
    cost = system.linearize(poses, scale, eliminate=False)
    system.set_weights(weights)
    return _Run(cost, initial_cost, iterations, run.converged)


def _squared_residuals(graph: PoseGraph, poses: FloatArray) -> FloatArray:
    """Return E^2 (eq. 4) of every constraint, poses of shape (num_vertices, 3)."""
    squared = np.empty(graph.num_constraints)
    pose_residuals.squared_residuals(
        poses,
        np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2]))),
        *constraint_ends(graph),
        measured_rows(graph, np.arange(graph.num_constraints)),
        squared,
    )
    return squared
