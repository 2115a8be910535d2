# SPDX-License-Identifier: Apache-2.0
"""Decisions which measurements are in, and which out: what truncated least squares needs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.kernels.pose_adjustment.layout import GroupLosses
from cartoloop.kernels.pose_adjustment.losses import DECIDED, FIXED_WEIGHTS, Loss
from cartoloop.pose_adjustment.chordal import better_start
from cartoloop.pose_adjustment.descent import Descent, Run
from cartoloop.pose_adjustment.linearise import cost_at
from cartoloop.pose_adjustment.losses import GroupLoss, kernel_losses
from cartoloop.pose_adjustment.problem import Measurements

_MAX_CHANGES = 10
"""How often a decision from where the poses are may change."""


class Decision:
    """Which measurements are in, and which out.

    Parameters
    ----------
    descent : for the plan of a problem.
    measured : of that problem.
    losses : of each group; decided upon are those of `DECIDED` losses.

    Attributes
    ----------
    descent, measured : as given.
    truncated : the losses as kernels read them.
    weighted : the same, with weights in the place of what is decided.
    weights : of all measurements, shape (n,), in [0, 1].
    iterations : linear systems solved so far.
    """

    def __init__(
        self, descent: Descent, measured: Measurements, losses: Sequence[GroupLoss]
    ) -> None:
        self.descent = descent
        self.measured = measured
        self.truncated = kernel_losses(losses)
        self._is_decided = np.array([group.loss in DECIDED for group in losses])
        codes = np.where(self._is_decided, FIXED_WEIGHTS, self.truncated.codes)
        self.weighted = self.truncated._replace(codes=codes)
        self._own = np.flatnonzero(self._is_decided[measured.groups])
        self.scales = self.truncated.scales[measured.groups[self._own]]
        self.squared = np.zeros(self._own.size)
        self.weights = np.ones(measured.groups.size)
        self.iterations = 0

    @property
    def num_in(self) -> int:
        """Number of measurements that are in, of those decided upon."""
        return int(np.count_nonzero(self.weights[self._own]))

    @property
    def own_weights(self) -> FloatArray:
        """Weights of the measurements decided upon, shape (m,)."""
        return self.weights[self._own]

    def with_loss(self, loss: Loss) -> GroupLosses:
        """Return the losses with another, at its default scale, in the place of what is decided."""
        truncated = self.truncated
        return GroupLosses(
            np.where(self._is_decided, loss.code, truncated.codes),
            np.where(self._is_decided, loss.default_scale, truncated.scales),
        )

    def explains_itself(self) -> bool:
        """Return whether what is in fits, and what is out does not, at the last poses."""
        fits = self.squared <= self.scales**2
        return bool((fits == (self.own_weights > 0.0)).all())

    def decide_all(self, weights: FloatArray | BoolArray) -> None:
        """Set the weights of the measurements decided upon, shape (m,)."""
        self.weights[self._own] = weights

    def lower(self, poses: FloatArray, descent: Descent | None = None) -> Run:
        """Return the descent from some poses with the present weights."""
        self.descent.plan.set_weights(self.weights)
        return self.note((descent or self.descent).run(poses, self.weighted))

    def settle(self, run: Run) -> Run:
        """Take in what fits where a run ended, leave out what does not, until that stands."""
        for _ in range(_MAX_CHANGES):
            self.decide_all(self.squared <= self.scales**2)
            run = self.lower(run.poses)
            if self.explains_itself():
                break
        return self.judged(run)

    def note(self, run: Run) -> Run:
        """Note the residuals where a run ended."""
        self.iterations += run.iterations
        self.squared = self.measured.residuals(run.poses).squared[self._own]
        return run

    def judged(self, run: Run) -> Run:
        """Return a run with its truncated cost."""
        return replace(run, cost=cost_at(self.descent.plan, run.poses, self.truncated))


def all_believed(decision: Decision) -> Run:
    """Return the least squares solution: everything is in."""
    plan = decision.descent.plan
    decision.weights[:] = 1.0
    plan.set_weights(decision.weights)
    return decision.lower(better_start(plan, decision.measured, decision.weighted))


def decide(
    decision: Decision, how: Callable[[Decision, FloatArray], Run], believed: BoolArray | None
) -> Run:
    """Return the poses and set the weights, 0 or 1 where is decided.

    Parameters
    ----------
    how : decides, given where the poses of all vertices are.
    believed : which of the first measurements an earlier adjustment believed, shape (k,); None if
        there was none. That decision stands, at the cost of a single descent, if it still explains
        itself with all new measurements believed: what it believes is within the scale, what it
        does not is outside.
    """
    plan = decision.descent.plan
    poses = plan.problem.poses()
    initial_cost = cost_at(plan, poses, decision.truncated)
    run: Run | None = None
    if believed is not None and not believed.all():
        decision.weights[: believed.size] = believed
        run = decision.lower(poses.copy())
    if run is None or not decision.explains_itself():
        run = how(decision, poses)
    plan.set_weights(decision.weights)
    cost = cost_at(plan, run.poses, decision.truncated)
    return Run(run.poses, cost, initial_cost, decision.iterations, run.converged)


def as_decided(decision: Decision, weights: FloatArray) -> Run:
    """Return the poses for a decision that was made before.

    Parameters
    ----------
    weights : of all measurements, shape (n,); used where is decided.
    """
    plan = decision.descent.plan
    poses = plan.problem.poses()
    initial_cost = cost_at(plan, poses, decision.truncated)
    decision.weights[:] = weights
    run = decision.judged(decision.lower(poses))
    return replace(run, initial_cost=initial_cost, iterations=decision.iterations)
