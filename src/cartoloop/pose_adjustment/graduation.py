# SPDX-License-Identifier: Apache-2.0
"""Graduated non-convexity around the descent: which measurements are in, and which out.

Yang et al., "Graduated Non-Convexity for Robust Spatial Perception" (2020).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.kernels.pose_adjustment.losses import FIXED_WEIGHTS, Loss
from cartoloop.pose_adjustment.chordal import better_start
from cartoloop.pose_adjustment.descent import Descent, Run
from cartoloop.pose_adjustment.linearise import cost_at
from cartoloop.pose_adjustment.losses import (
    GroupLoss,
    initial_convexity,
    kernel_losses,
    truncated_weights,
)
from cartoloop.pose_adjustment.problem import Measurements

_GRADUATION = 1.4
"""Factor of mu from one round of graduated non-convexity to the next (Yang et al., 2020)."""
_MAX_ROUNDS = 10
"""Graduated non-convexity may solve as many linear systems as this many adjustments."""
_MAX_CHANGES = 10
"""How often a decision from where the poses are may change."""


def graduate(
    descent: Descent,
    measured: Measurements,
    losses: Sequence[GroupLoss],
    believed: BoolArray | None,
) -> Run:
    """Return the poses and set the weights, 0 or 1 in the groups concerned.

    Parameters
    ----------
    descent : for the plan.
    measured : of its problem.
    losses : of each group, one of them at least `Loss.GRADUATED_NON_CONVEXITY`.
    believed : which of the first measurements an earlier adjustment believed, shape (k,); None if
        there was none. That decision stands, at the cost of a single descent, if it still explains
        itself with all new measurements believed: what it believes is within the scale, what it
        does not is outside.

    Notes
    -----
    It decides twice: while the loss hardens, from least squares, which no start misleads, but which
    many false measurements that agree with each other can; and from where the poses are, which is
    right if they nearly are. The lower truncated cost wins.
    """
    plan = descent.plan
    decision = _Decision(descent, measured, losses)
    poses = plan.problem.poses()
    initial_cost = cost_at(plan, poses, decision.truncated)
    run: Run | None = None
    if believed is not None and not believed.all():
        decision.weights[: believed.size] = believed
        run = decision.lower(poses)
    if run is None or not decision.explains_itself():
        run = decision.from_least_squares()
        if not decision.explains_itself():
            harden = decision.while_hardening(run)
            hardened_weights = decision.weights.copy()
            run = decision.from_poses(poses)
            if not run.cost < harden.cost:
                run, decision.weights[:] = harden, hardened_weights
    plan.set_weights(decision.weights)
    return Run(run.poses, run.cost, initial_cost, decision.iterations, run.converged)


class _Decision:
    """Which measurements are in, and which out.

    Attributes
    ----------
    truncated : the losses.
    weights : of all measurements, shape (n,), in [0, 1].
    iterations : linear systems solved so far.
    """

    def __init__(
        self, descent: Descent, measured: Measurements, losses: Sequence[GroupLoss]
    ) -> None:
        self._descent = descent
        self._one_step = replace(descent, max_iterations=1)
        self._measured = measured
        self.truncated = kernel_losses(losses)
        is_graduated = np.array([group.loss is Loss.GRADUATED_NON_CONVEXITY for group in losses])
        codes = self.truncated.codes
        self._weighted = self.truncated._replace(codes=np.where(is_graduated, FIXED_WEIGHTS, codes))
        scaling = Loss.DYNAMIC_COVARIANCE_SCALING.code
        self._scaled = self.truncated._replace(codes=np.where(is_graduated, scaling, codes))
        self._graduated = np.flatnonzero(is_graduated[measured.groups])
        self._scales = self.truncated.scales[measured.groups[self._graduated]]
        self._squared = np.zeros(self._graduated.size)
        self.weights = np.ones(measured.groups.size)
        self.iterations = 0

    def explains_itself(self) -> bool:
        """Return whether what is in fits, and what is out does not, at the last poses."""
        fits = self._squared <= self._scales**2
        return bool((fits == (self.weights[self._graduated] > 0.0)).all())

    def lower(self, poses: FloatArray, descent: Descent | None = None) -> Run:
        """Return the descent from some poses with the present weights."""
        plan = self._descent.plan
        plan.set_weights(self.weights)
        return self._note((descent or self._descent).run(poses, self._weighted))

    def from_least_squares(self) -> Run:
        """Believe everything."""
        self.weights[:] = 1.0
        plan = self._descent.plan
        plan.set_weights(self.weights)
        return self.lower(better_start(plan, self._measured, self._weighted))

    def while_hardening(self, run: Run) -> Run:
        """Decide from the least squares solution, while the loss hardens."""
        mu = initial_convexity(self._squared, self._scales)
        is_decided = False
        most = self.iterations + self._descent.max_iterations * _MAX_ROUNDS
        while not is_decided and self.iterations < most:
            self.weights[self._graduated] = truncated_weights(self._squared, self._scales, mu)
            is_decided = bool(((self.weights == 0.0) | (self.weights == 1.0)).all())
            # the weights change little from round to round: but for the last, a step is enough
            run = self.lower(run.poses, None if is_decided else self._one_step)
            mu *= _GRADUATION
        return self._judged(run)

    def from_poses(self, poses: FloatArray) -> Run:
        """Decide by what fits near some poses."""
        run = self._note(self._descent.run(poses, self._scaled))
        for _ in range(_MAX_CHANGES):
            self.weights[self._graduated] = self._squared <= self._scales**2
            run = self.lower(run.poses)
            if self.explains_itself():
                break
        return self._judged(run)

    def _note(self, run: Run) -> Run:
        self.iterations += run.iterations
        self._squared = self._measured.residuals(run.poses).squared[self._graduated]
        return run

    def _judged(self, run: Run) -> Run:
        """Return a run with its truncated cost."""
        return replace(run, cost=cost_at(self._descent.plan, run.poses, self.truncated))
