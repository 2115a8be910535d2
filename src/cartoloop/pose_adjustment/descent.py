# SPDX-License-Identifier: Apache-2.0
"""Levenberg-Marquardt.

It begins as undamped Gauss-Newton and adds damping only where a step fails to lower the cost or the
system cannot be factored.
"""

from __future__ import annotations

from dataclasses import dataclass

from cartoloop.arrays import FloatArray
from cartoloop.kernels.pose_adjustment.layout import GroupLosses
from cartoloop.pose_adjustment.linearise import Linearised, cost_at, linearise
from cartoloop.pose_adjustment.plan import Plan

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


@dataclass(frozen=True, slots=True)
class Run:
    """What lowering the cost came to.

    Attributes
    ----------
    poses : of all vertices, shape (num_vertices, 3) [m, m, rad].
    cost, initial_cost : half the sum of rho(E^2), after and before.
    iterations : linear systems solved.
    converged : False if it stopped at the maximum number of iterations.
    """

    poses: FloatArray
    cost: float
    initial_cost: float
    iterations: int
    converged: bool


@dataclass(frozen=True, slots=True)
class Descent:
    """Lowers the cost until it changes no more.

    Attributes
    ----------
    plan : of the problem.
    max_iterations : linear systems solved at most.
    tolerance : relative change of the cost below which the result stands.
    """

    plan: Plan
    max_iterations: int
    tolerance: float

    def run(self, poses: FloatArray, losses: GroupLosses) -> Run:
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
        return Run(poses, cost, initial_cost, iterations, converged)
