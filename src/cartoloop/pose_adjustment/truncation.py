# SPDX-License-Identifier: Apache-2.0
"""Truncated least squares from where Huber's loss ends: what is in, and what is out."""

from __future__ import annotations

from cartoloop.arrays import FloatArray
from cartoloop.kernels.pose_adjustment.losses import Loss
from cartoloop.pose_adjustment.chordal import better_start
from cartoloop.pose_adjustment.decision import Decision, all_believed
from cartoloop.pose_adjustment.descent import Run

_MIN_MORE = 2
"""Least squares must keep at least this number of measurements more: a single one may be false."""


def truncate(decision: Decision, poses: FloatArray) -> Run:
    """Decide which measurements are in.

    Parameters
    ----------
    decision : upon groups of `Loss.TRUNCATED`.
    poses : of all vertices, where they are.

    Notes
    -----
    It decides three times: from the minimum of Huber's loss, which no start misleads and which
    keeps true measurements that agree on a long way; from least squares, in which the influence of
    the few that first close a long loop is not limited; and by a strict loss from where the poses
    are, which a majority of false measurements does not move. The decision that keeps most wins.
    The cost alone is no judge: what is left out costs little, and where the model is too sure of
    itself, the decision of least cost leaves out the loops that are true. But least squares is
    drawn to what is false, so it must keep more at less cost.
    """
    descent = decision.descent
    huber = decision.with_loss(Loss.HUBER)
    start = better_start(descent.plan, decision.measured, huber)
    run = decision.settle(decision.note(descent.run(start, huber)))
    if decision.own_weights.all():
        return run
    kept, num_kept = decision.weights.copy(), decision.num_in
    other = _from_least_squares(decision)
    if decision.num_in >= num_kept + _MIN_MORE and other.cost < run.cost:
        run, kept, num_kept = other, decision.weights.copy(), decision.num_in
    other = _from_poses(decision, poses)
    if decision.num_in > num_kept:
        run, kept, num_kept = other, decision.weights.copy(), decision.num_in
    decision.weights[:] = kept
    return run


def _from_least_squares(decision: Decision) -> Run:
    """Decide by what fits where all is believed."""
    return decision.settle(all_believed(decision))


def _from_poses(decision: Decision, poses: FloatArray) -> Run:
    """Decide by what fits near some poses."""
    for loss in (Loss.CAUCHY, Loss.DYNAMIC_COVARIANCE_SCALING):
        run = decision.note(decision.descent.run(poses, decision.with_loss(loss)))
        poses = run.poses
    return decision.settle(run)
