# SPDX-License-Identifier: Apache-2.0
"""Sparse pose adjustment (section V-A, eq. SPA): a library of its own, see the README beside this.

problem = Problem(submap_poses, node_poses, constraints, control_points(...))
result = solve(plan(problem), [GroupLoss(), GroupLoss(Loss.HUBER)])
"""

from cartoloop.kernels.pose_adjustment.losses import Loss
from cartoloop.kernels.pose_adjustment.residuals import Residuals
from cartoloop.pose_adjustment.chordal import chordal_start, is_far_off
from cartoloop.pose_adjustment.linearise import Linearised, Step, cost_at, linearise
from cartoloop.pose_adjustment.losses import GroupLoss, kernel_losses, loss_weights, scale_of
from cartoloop.pose_adjustment.plan import Plan, Planner, plan
from cartoloop.pose_adjustment.problem import (
    Constraints,
    ControlPoints,
    Measurements,
    Problem,
    control_points,
    held_vertices,
    residuals,
)
from cartoloop.pose_adjustment.solve import Solution, solve

__all__ = [
    "Constraints",
    "ControlPoints",
    "GroupLoss",
    "Linearised",
    "Loss",
    "Measurements",
    "Plan",
    "Planner",
    "Problem",
    "Residuals",
    "Solution",
    "Step",
    "chordal_start",
    "control_points",
    "cost_at",
    "held_vertices",
    "is_far_off",
    "kernel_losses",
    "linearise",
    "loss_weights",
    "plan",
    "residuals",
    "scale_of",
    "solve",
]
