# SPDX-License-Identifier: Apache-2.0
"""Truncated least squares from where Huber's loss ends: what is in, and what is out."""

from __future__ import annotations

from collections.abc import Sequence

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.kernels.pose_adjustment.losses import Loss
from cartoloop.pose_adjustment.chordal import better_start
from cartoloop.pose_adjustment.decision import Decision
from cartoloop.pose_adjustment.descent import Descent, Run
from cartoloop.pose_adjustment.linearise import cost_at
from cartoloop.pose_adjustment.losses import GroupLoss
from cartoloop.pose_adjustment.problem import Measurements


def truncate(
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
    losses : of each group, one of them at least `Loss.TRUNCATED`.
    believed : which of the first measurements an earlier adjustment believed, shape (k,); None if
        there was none. That decision stands, at the cost of a single descent, if it still explains
        itself with all new measurements believed.

    Notes
    -----
    It decides twice: from the minimum of Huber's loss, which no start misleads and which keeps true
    measurements that agree on a long way; and by a strict loss from where the poses are, which a
    majority of false measurements does not move. The decision that keeps more wins. The cost is no
    judge: what is left out costs little, and where the model is too sure of itself, the decision of
    least cost leaves out the loops that are true.
    """
    plan = descent.plan
    decision = Decision(descent, measured, losses)
    poses = plan.problem.poses()
    initial_cost = cost_at(plan, poses, decision.truncated)
    run = decision.earlier(poses.copy(), believed)
    if run is not None:
        return decision.result(decision.judged(run), initial_cost)
    huber = decision.with_loss(Loss.HUBER)
    start = better_start(plan, measured, huber)
    run = decision.settle(decision.note(descent.run(start, huber)))
    if not decision.own_weights.all():
        kept, num_kept = decision.weights.copy(), decision.num_in
        near = _from_poses(decision, descent, poses)
        if decision.num_in > num_kept:
            run = near
        else:
            decision.weights[:] = kept
    return decision.result(run, initial_cost)


def _from_poses(decision: Decision, descent: Descent, poses: FloatArray) -> Run:
    """Decide by what fits near some poses."""
    for loss in (Loss.CAUCHY, Loss.DYNAMIC_COVARIANCE_SCALING):
        run = decision.note(descent.run(poses, decision.with_loss(loss)))
        poses = run.poses
    return decision.settle(run)
