# SPDX-License-Identifier: Apache-2.0
"""Levenberg-Marquardt, and graduated non-convexity around it.

It begins as undamped Gauss-Newton and adds damping only where a step fails to lower the cost or the
system cannot be factored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.pose_adjustment.layout import GroupLosses
from cartoloop.kernels.pose_adjustment.losses import FIXED_WEIGHTS, Loss
from cartoloop.kernels.pose_adjustment.residuals import Residuals, measure_residuals
from cartoloop.pose_adjustment.linearise import Linearised, cost_at, linearise
from cartoloop.pose_adjustment.losses import (
    GroupLoss,
    initial_convexity,
    kernel_losses,
    truncated_weights,
)
from cartoloop.pose_adjustment.plan import Plan
from cartoloop.sensor.pose import wrap_angles

_FIRST_DAMPING = 1e-9
"""First share of the diagonal: far below what changes a well determined step."""
_MAX_DAMPING = 1e8
"""No step is left to try: steps are then 1e-8 of a gradient step."""
_DAMPING_GROWTH = 10.0
"""Factor of the damping after a failed step (Marquardt, 1963), squared if the next fails, too."""
_GOOD_GAIN = 0.5
"""Share of the predicted decrease that must be reached for the damping to shrink."""
_VANISHING_COST = 1e-20
"""Cost of rounding errors: all constraints are satisfied."""
_LAST_STEP = 1e-3
"""Predicted share of the cost below which a step is likely the last: nodes are not eliminated for
another. Affects only the run time."""
_GRADUATION = 1.4
"""Factor of mu from one round of graduated non-convexity to the next (Yang et al., 2020)."""
_MAX_ROUNDS = 10
"""Graduated non-convexity may solve as many linear systems as this many adjustments."""


@dataclass(frozen=True, slots=True)
class Solution:
    """What an adjustment did.

    Attributes
    ----------
    submap_poses, node_poses : where the constraints agree best, as in the problem.
    cost, initial_cost : half the sum of rho(E^2), after and before (eq. SPA).
    iterations : linear systems solved.
    converged : False if it stopped at the maximum number of iterations.
    weights : what the losses leave of each constraint's information, in [0, 1].
    control_weights : the same for each control point.
    """

    submap_poses: FloatArray
    node_poses: FloatArray
    cost: float
    initial_cost: float
    iterations: int
    converged: bool
    weights: FloatArray
    control_weights: FloatArray


def solve(
    plan: Plan,
    losses: Sequence[GroupLoss],
    *,
    max_iterations: int = 50,
    relative_tolerance: float = 1e-6,
) -> Solution:
    """Return the poses at which the constraints of a problem agree best.

    Parameters
    ----------
    plan : of the problem.
    losses : of each group of constraints.
    max_iterations : linear systems solved at most.
    relative_tolerance : change of the cost, as a share of it, below which the result stands.

    Notes
    -----
    Same problem, same losses, same bytes, no matter how often it was planned while it grew to its
    present size. Cost per iteration: linear in the constraints, plus the sparse factorization of
    the submaps and of the nodes that are not eliminated.

    Raises
    ------
    ValueError
        If a constraint belongs to a group without a loss.
    """
    problem = plan.problem
    if plan.num_groups > len(losses):
        raise ValueError(
            f"constraints belong to {plan.num_groups} groups, but {len(losses)} have a loss: "
            "give each group one"
        )
    descent = _Descent(plan, max_iterations, relative_tolerance)
    if any(group.loss is Loss.GRADUATED_NON_CONVEXITY for group in losses):
        run = _graduate(descent, problem.poses(), losses)
    else:
        run = descent.run(problem.poses(), kernel_losses(losses))
    poses = run.poses
    poses[:, 2] = wrap_angles(poses[:, 2])
    weights, num_constraints = plan.weights(), problem.constraints.groups.size
    return Solution(
        poses[: problem.num_submaps],
        poses[problem.num_submaps : problem.map_frame],
        run.cost,
        run.initial_cost,
        run.iterations,
        run.converged,
        weights[:num_constraints],
        weights[num_constraints:],
    )


@dataclass(frozen=True, slots=True)
class _Run:
    poses: FloatArray
    cost: float
    initial_cost: float
    iterations: int
    converged: bool


@dataclass(frozen=True, slots=True)
class _Descent:
    """Lowers the cost until it changes no more."""

    plan: Plan
    max_iterations: int
    tolerance: float

    def run(self, poses: FloatArray, losses: GroupLosses) -> _Run:
        """Return the poses of least cost near `poses`, which is scratch afterwards."""
        plan, tolerance = self.plan, self.tolerance
        trial = poses.copy()  # held vertices are never written
        damping = least_damping = 0.0
        growth = _DAMPING_GROWTH
        system: Linearised | None
        system = start = linearise(plan, poses, losses, damping)
        initial_cost = cost = start.cost
        converged = cost <= _VANISHING_COST
        iterations = 0
        while not converged and iterations < self.max_iterations and damping <= _MAX_DAMPING:
            iterations += 1
            if system is None or system.damping != damping:
                system = linearise(plan, poses, losses, damping)
            step = system.step()
            system = None
            if step is None:
                damping = least_damping = max(_DAMPING_GROWTH * damping, _FIRST_DAMPING)
                continue
            step.move(trial)
            predicted = step.decrease
            if predicted > _LAST_STEP * cost and iterations < self.max_iterations:
                ahead = linearise(plan, trial, losses, damping)
                trial_cost = ahead.cost
            else:
                ahead, trial_cost = None, cost_at(plan, trial, losses)
            if not trial_cost < cost:
                converged = predicted <= tolerance * cost
                damping = max(growth * damping, _FIRST_DAMPING)
                growth *= 2.0
                continue
            decrease = cost - trial_cost
            # the error of an undamped step's model is about what the next step could gain
            left = abs(decrease - predicted) if damping == 0.0 else decrease
            converged = (
                min(decrease, left) <= tolerance * trial_cost or trial_cost <= _VANISHING_COST
            )
            if growth == _DAMPING_GROWTH and decrease > _GOOD_GAIN * predicted:
                damping = damping / _DAMPING_GROWTH if damping > _FIRST_DAMPING else least_damping
            growth = _DAMPING_GROWTH
            poses, trial = trial, poses
            system, cost = ahead, trial_cost
        return _Run(poses, cost, initial_cost, iterations, converged)


def _graduate(descent: _Descent, poses: FloatArray, losses: Sequence[GroupLoss]) -> _Run:
    """Graduated non-convexity: alternate weights and poses while the loss hardens step by step."""
    plan, truncated = descent.plan, kernel_losses(losses)
    initial_cost = cost_at(plan, poses, truncated)
    is_graduated = np.array([group.loss is Loss.GRADUATED_NON_CONVEXITY for group in losses])
    weighted = truncated._replace(codes=np.where(is_graduated, FIXED_WEIGHTS, truncated.codes))
    columns = _Columns.of(plan)
    graduated = np.flatnonzero(is_graduated[columns.groups])
    scales = truncated.scales[columns.groups[graduated]]
    weights = np.ones(columns.groups.size)
    plan.set_weights(weights)
    run = descent.run(poses, weighted)
    iterations = run.iterations
    squared = columns.squared(run.poses)[graduated]
    mu = initial_convexity(squared, scales) if graduated.size else np.inf
    while np.isfinite(mu) and iterations < descent.max_iterations * _MAX_ROUNDS:
        weights[graduated] = truncated_weights(squared, scales, mu)
        plan.set_weights(weights)
        run = descent.run(run.poses, weighted)
        iterations += run.iterations
        if np.isin(weights[graduated], (0.0, 1.0)).all():
            break
        squared = columns.squared(run.poses)[graduated]
        mu *= _GRADUATION
    cost = cost_at(plan, run.poses, truncated)
    plan.set_weights(weights)
    return _Run(run.poses, cost, initial_cost, iterations, run.converged)


@dataclass(frozen=True, slots=True)
class _Columns:
    """All measurements of a problem: constraints, then control points."""

    groups: IntArray
    vertex_a: IntArray
    vertex_b: IntArray
    tf_a_b: FloatArray
    informations: FloatArray

    @classmethod
    def of(cls, plan: Plan) -> _Columns:
        problem, constraints = plan.problem, plan.problem.constraints
        own = cls(constraints.groups, *problem.ends(), constraints.tf_a_b, constraints.informations)
        points = problem.control_points
        if points is None:
            return own
        frame = np.full(points.nodes.size, problem.map_frame)
        return cls(
            np.concatenate((own.groups, points.groups)),
            np.concatenate((own.vertex_a, frame)),
            np.concatenate((own.vertex_b, problem.num_submaps + points.nodes)),
            np.concatenate((own.tf_a_b, points.tf_map_node)),
            np.concatenate((own.informations, points.informations)),
        )

    def squared(self, poses: FloatArray) -> FloatArray:
        """Return E^2 of all at these poses."""
        out = Residuals(*np.empty((3, self.groups.size)))
        measure_residuals(poses, self.vertex_a, self.vertex_b, self.tf_a_b, self.informations, out)
        return out.squared
