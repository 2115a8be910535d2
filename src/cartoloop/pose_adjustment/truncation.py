# SPDX-License-Identifier: Apache-2.0
"""Truncated least squares from where Huber's loss ends: what is in, and what is out."""

from __future__ import annotations

from dataclasses import replace

from cartoloop.arrays import FloatArray
from cartoloop.kernels.pose_adjustment.losses import Loss
from cartoloop.pose_adjustment.chordal import better_start
from cartoloop.pose_adjustment.decision import Decision, all_believed
from cartoloop.pose_adjustment.descent import Run

_MIN_MORE = 2
"""Least number of further measurements that must be in from least squares: one may be false."""

_NEARLY_ALL = 0.97
"""Where Huber's minimum keeps this share of the measurements, nothing can be much better. Otherwise
this share of what the others keep is enough for a decision from where the poses are: false
measurements that agree with each other, and outnumber the true ones at one end of the graph, bend
that end to them, which keeps a little more."""

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
    It decides from the minimum of Huber's loss, which no start misleads and which keeps true
    measurements that agree on a long path. Where that leaves out more than a few, it decides twice
    more: from least squares, in which the few that first close a long loop have their full weight;
    and by a strict loss from where the poses are, which a majority of false measurements does not
    move. The decision that keeps most wins, the last one if it keeps nearly as much. The cost alone
    is no judge: what is left out costs little, and where the model is too sure of itself, the
    decision of least cost leaves out the loops that are true. But least squares is drawn to what is
    false, so it must keep more at less cost.
    """
    descent = decision.descent
    huber = decision.with_loss(Loss.HUBER)
    start = better_start(descent.plan, decision.measured, huber)
    run = decision.settle(decision.note(descent.run(start, huber)))
    if decision.num_in >= _NEARLY_ALL * decision.own_weights.size:
        return run
    kept, num_kept = decision.weights.copy(), decision.num_in
    other = decision.settle(all_believed(decision))
    if decision.num_in >= num_kept + _MIN_MORE and other.cost < run.cost:
        run, kept, num_kept = other, decision.weights.copy(), decision.num_in
    other = _from_poses(decision, poses)
    if decision.num_in >= _NEARLY_ALL * num_kept:
        return other
    decision.weights[:] = kept
    return run


def _from_poses(decision: Decision, poses: FloatArray) -> Run:
    """Decide by what fits near some poses."""
    descent = replace(decision.descent, max_iterations=_MAX_ITERATIONS)
    for loss in (Loss.CAUCHY, Loss.DYNAMIC_COVARIANCE_SCALING):
        run = decision.note(descent.run(poses, decision.with_loss(loss)))
        poses = run.poses
    return decision.settle(run)
