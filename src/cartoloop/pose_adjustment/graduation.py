# SPDX-License-Identifier: Apache-2.0
"""Graduated non-convexity around the descent: which measurements are in, and which out.

Yang et al., "Graduated Non-Convexity for Robust Spatial Perception" (2020).
"""

from __future__ import annotations

from dataclasses import replace

from cartoloop.arrays import FloatArray
from cartoloop.kernels.pose_adjustment.losses import Loss
from cartoloop.pose_adjustment.decision import Decision, all_believed
from cartoloop.pose_adjustment.descent import Run
from cartoloop.pose_adjustment.losses import initial_convexity, truncated_weights

_GRADUATION = 1.4
"""Factor of mu from one round of graduated non-convexity to the next (Yang et al., 2020)."""
_MAX_ROUNDS = 10
"""Graduated non-convexity may solve as many linear systems as this many adjustments."""
_SCALED = Loss.DYNAMIC_COVARIANCE_SCALING
"""Loss of the descent from where the poses are."""


def graduate(decision: Decision, poses: FloatArray) -> Run:
    """Decide which measurements are in.

    Parameters
    ----------
    decision : upon groups of `Loss.GRADUATED_NON_CONVEXITY`.
    poses : of all vertices, where they are.

    Notes
    -----
    It decides twice: while the loss hardens, from least squares, which no start misleads, but which
    many false measurements that agree with each other can; and from where the poses are, which is
    right if they nearly are. The lower truncated cost wins.
    """
    run = all_believed(decision)
    if decision.explains_itself():
        return run
    harden = _while_hardening(decision, run)
    hardened_weights = decision.weights.copy()
    scaled = decision.truncated._replace(codes=decision.with_loss(_SCALED).codes)
    run = decision.settle(decision.note(decision.descent.run(poses, scaled)))
    if run.cost < harden.cost:
        return run
    decision.weights[:] = hardened_weights
    return harden


def _while_hardening(decision: Decision, run: Run) -> Run:
    """Decide from the least squares solution, while the loss hardens."""
    mu = initial_convexity(decision.squared, decision.scales)
    one_step = replace(decision.descent, max_iterations=1)
    is_decided = False
    most = decision.iterations + decision.descent.max_iterations * _MAX_ROUNDS
    while not is_decided and decision.iterations < most:
        decision.decide_all(truncated_weights(decision.squared, decision.scales, mu))
        is_decided = bool(((decision.weights == 0.0) | (decision.weights == 1.0)).all())
        # the weights change little from round to round: but for the last, a step is enough
        run = decision.lower(run.poses, None if is_decided else one_step)
        mu *= _GRADUATION
    return decision.judged(run)
