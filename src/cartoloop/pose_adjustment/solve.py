# SPDX-License-Identifier: Apache-2.0
"""The poses at which the measurements of a problem agree best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.kernels.pose_adjustment.losses import DECIDED, Loss
from cartoloop.pose_adjustment.chordal import better_start
from cartoloop.pose_adjustment.decision import Decision, as_decided, decide
from cartoloop.pose_adjustment.descent import Descent
from cartoloop.pose_adjustment.graduation import graduate
from cartoloop.pose_adjustment.losses import GroupLoss, kernel_losses
from cartoloop.pose_adjustment.plan import Plan
from cartoloop.pose_adjustment.problem import Measurements
from cartoloop.pose_adjustment.truncation import truncate
from cartoloop.sensor.pose import wrap_angles


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
    believed: BoolArray | None = None,
    weights: FloatArray | None = None,
) -> Solution:
    """Return the poses at which the constraints of a problem agree best.

    Parameters
    ----------
    plan : of the problem.
    losses : of each group of constraints.
    max_iterations : linear systems solved at most.
    relative_tolerance : change of the cost, as a share of it, below which the result stands.
    believed : which of the first constraints an earlier adjustment left a weight, shape (k,): where
        that is still right, truncated losses do not have to decide again.
    weights : of all measurements, constraints and then control points, in [0, 1]: truncated losses
        do not decide, and leave as much of each as given; None: they decide.

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
    descent = Descent(plan, max_iterations, relative_tolerance)
    measured = Measurements.of(problem)
    used = {group.loss for group in losses}
    if used & DECIDED:
        how = graduate if Loss.GRADUATED_NON_CONVEXITY in used else truncate
        decision = Decision(descent, measured, losses)
        run = decide(decision, how, believed) if weights is None else as_decided(decision, weights)
    else:
        kernel = kernel_losses(losses)
        start = better_start(plan, measured, kernel) if max_iterations else problem.poses()
        run = descent.run(start, kernel)
    poses = run.poses
    poses[:, 2] = wrap_angles(poses[:, 2])
    left, num_constraints = plan.weights(), problem.constraints.groups.size
    return Solution(
        poses[: problem.num_submaps],
        poses[problem.num_submaps : problem.map_frame],
        run.cost,
        run.initial_cost,
        run.iterations,
        run.converged,
        left[:num_constraints],
        left[num_constraints:],
    )
