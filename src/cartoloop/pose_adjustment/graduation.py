# SPDX-License-Identifier: Apache-2.0
"""Graduated non-convexity around the descent: which measurements are in, and which out.

Yang et al., "Graduated Non-Convexity for Robust Spatial Perception" (2020).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cartoloop.arrays import BoolArray
from cartoloop.kernels.pose_adjustment.losses import Loss
from cartoloop.pose_adjustment.chordal import better_start
from cartoloop.pose_adjustment.decision import Decision
from cartoloop.pose_adjustment.descent import Descent, Run
from cartoloop.pose_adjustment.linearise import cost_at
from cartoloop.pose_adjustment.losses import GroupLoss, initial_convexity, truncated_weights
from cartoloop.pose_adjustment.plan import Plan
from cartoloop.pose_adjustment.problem import Measurements

_GRADUATION = 1.4
"""Factor of mu from one round of graduated non-convexity to the next (Yang et al., 2020)."""
_MAX_ROUNDS = 10
"""Graduated non-convexity may solve as many linear systems as this many adjustments."""
_SCALED = Loss.DYNAMIC_COVARIANCE_SCALING
"""Loss of the descent from where the poses are."""


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
    decision = Decision(descent, measured, losses)
    poses = plan.problem.poses()
    initial_cost = cost_at(plan, poses, decision.truncated)
    run = decision.earlier(poses, believed)
    if run is None:
        run = _from_least_squares(decision, plan, measured)
        if not decision.explains_itself():
            harden = _while_hardening(decision, descent, run)
            hardened_weights = decision.weights.copy()
            scaled = decision.truncated._replace(codes=decision.with_loss(_SCALED).codes)
            run = decision.settle(decision.note(descent.run(poses, scaled)))
            if not run.cost < harden.cost:
                run, decision.weights[:] = harden, hardened_weights
    return decision.result(run, initial_cost)


def _from_least_squares(decision: Decision, plan: Plan, measured: Measurements) -> Run:
    """Believe everything."""
    decision.weights[:] = 1.0
    plan.set_weights(decision.weights)
    return decision.lower(better_start(plan, measured, decision.weighted))


def _while_hardening(decision: Decision, descent: Descent, run: Run) -> Run:
    """Decide from the least squares solution, while the loss hardens."""
    mu = initial_convexity(decision.squared, decision.scales)
    one_step = replace(descent, max_iterations=1)
    is_decided = False
    most = decision.iterations + descent.max_iterations * _MAX_ROUNDS
    while not is_decided and decision.iterations < most:
        decision.decide_all(truncated_weights(decision.squared, decision.scales, mu))
        is_decided = bool(((decision.weights == 0.0) | (decision.weights == 1.0)).all())
        # the weights change little from round to round: but for the last, a step is enough
        run = decision.lower(run.poses, None if is_decided else one_step)
        mu *= _GRADUATION
    return decision.judged(run)
