# SPDX-License-Identifier: Apache-2.0
"""Truncated least squares from where Huber's loss ends: what is in, and what is out."""

from __future__ import annotations

from dataclasses import replace

from cartoloop.arrays import FloatArray
from cartoloop.kernels.pose_adjustment.losses import Loss
from cartoloop.pose_adjustment.chordal import better_start
from cartoloop.pose_adjustment.decision import Decision
from cartoloop.pose_adjustment.descent import Run

_FEW_OUT = 0.97
"""Where Huber's minimum keeps this share of the measurements, it wins unless the other decision
keeps more; otherwise this share of what it keeps is enough for the other. False measurements that
agree with each other, and outnumber the true ones at one end of the graph, bend that end to them,
which keeps a little more."""

_MAX_ITERATIONS = 8
"""Of each descent from where the poses are: what fits there is known long before it converges."""


def truncate(decision: Decision, poses: FloatArray) -> Run:
    """Decide which measurements are in.

    Parameters
    ----------
    decision : upon groups of `Loss.TRUNCATED`.
    poses : of all vertices, where they are.

    Notes
    -----
    It decides twice: from the minimum of Huber's loss, which no start misleads and which keeps true
    measurements that agree on a long way; and by a strict loss from where the poses are, which a
    majority of false measurements does not move. The decision that keeps more wins; where much is
    left out, the second wins if it keeps nearly as many. The cost is no judge: what is left out
    costs little, and where the model is too sure of itself, the decision of least cost leaves out
    the loops that are true.
    """
    descent = decision.descent
    huber = decision.with_loss(Loss.HUBER)
    start = better_start(descent.plan, decision.measured, huber)
    run = decision.settle(decision.note(descent.run(start, huber)))
    own = decision.own_weights
    if own.all():
        return run
    kept, num_kept = decision.weights.copy(), decision.num_in
    near = _from_poses(decision, poses)
    few_out = num_kept >= _FEW_OUT * own.size
    if decision.num_in > num_kept or (not few_out and decision.num_in >= _FEW_OUT * num_kept):
        return near
    decision.weights[:] = kept
    return run


def _from_poses(decision: Decision, poses: FloatArray) -> Run:
    """Decide by what fits near some poses."""
    descent = replace(decision.descent, max_iterations=_MAX_ITERATIONS)
    for loss in (Loss.CAUCHY, Loss.DYNAMIC_COVARIANCE_SCALING):
        run = decision.note(descent.run(poses, decision.with_loss(loss)))
        poses = run.poses
    return decision.settle(run)
