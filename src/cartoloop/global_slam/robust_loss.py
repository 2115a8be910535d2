# SPDX-License-Identifier: Apache-2.0
"""Loss functions that keep false loop closures from bending the map (rho of eq. SPA)."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from cartoloop.kernels import pose_residuals

FloatArray = NDArray[np.float64]


class Loss(StrEnum):
    """How the pull of a constraint wanes as its whitened residual E outgrows the scale."""

    NONE = "none"
    """Least squares: it does not."""
    HUBER = "huber"
    """The paper's: the pull stays constant. Convex, so it finds its way from a drifted start."""
    CAUCHY = "cauchy"
    """The pull fades as 1 / E."""
    DYNAMIC_COVARIANCE_SCALING = "dynamic_covariance_scaling"
    """The pull fades as 1 / E^3 (Agarwal et al., the paper's [16])."""
    GRADUATED_NON_CONVEXITY = "graduated_non_convexity"
    """Constraints are in or out; which is found by degrees (Yang et al., 2020)."""


KERNEL_LOSS = {
    Loss.NONE: pose_residuals.NO_LOSS,
    Loss.HUBER: pose_residuals.HUBER,
    Loss.CAUCHY: pose_residuals.CAUCHY,
    Loss.DYNAMIC_COVARIANCE_SCALING: pose_residuals.DYNAMIC_COVARIANCE_SCALING,
    Loss.GRADUATED_NON_CONVEXITY: pose_residuals.TRUNCATED,
}

DEFAULT_SCALE = {
    Loss.NONE: 1.0,
    Loss.HUBER: 10.0,
    Loss.CAUCHY: 3.0,
    Loss.DYNAMIC_COVARIANCE_SCALING: 3.0,
    Loss.GRADUATED_NON_CONVEXITY: 4.0,
}
"""Scale of each loss, in units of the whitened residual E: Huber's as in Cartographer; beyond 4 lie
0.1 % of true constraints (chi square of three degrees of freedom)."""


def loss_weights(squared: FloatArray, loss: Loss, scale: float) -> FloatArray:
    """Return what a loss leaves of each constraint's pull, in [0, 1]: rho' at E^2.

    Parameters
    ----------
    squared : E^2, shape (n,).
    loss, scale : where it sets in, in units of E.
    """
    code = KERNEL_LOSS[loss]
    weights = [pose_residuals.robust_loss(code, scale, s)[1] for s in squared.tolist()]
    return np.array(weights, dtype=np.float64)


def initial_convexity(squared: FloatArray, scale: float) -> float:
    """Return mu to start graduated non-convexity with: the loss is nearly convex for all residuals.

    Parameters
    ----------
    squared : E^2 of the constraints it acts on, at the least-squares solution, shape (n,), n > 0.
    scale : residual at which the loss is truncated, in units of E.

    Returns
    -------
    mu : positive; infinite if all residuals are within the scale, so that nothing is to be done.
    """
    excess = 2.0 * float(squared.max()) - scale * scale
    return scale * scale / excess if squared.max() > scale * scale else np.inf


def truncated_weights(squared: FloatArray, scale: float, mu: float) -> FloatArray:
    """Return the weights in [0, 1] of graduated non-convexity for truncated least squares.

    Yang et al., "Graduated Non-Convexity for Robust Spatial Perception" (2020), eq. 14; `squared`
    is E^2, shape (n,), and `mu` grows from near 0 (convex) to infinity (truncated).
    """
    limit = scale * scale
    partial = scale * np.sqrt(mu * (mu + 1.0) / np.maximum(squared, np.finfo(float).tiny)) - mu
    weights: FloatArray = np.where(
        squared <= mu / (mu + 1.0) * limit,
        1.0,
        np.where(squared >= (mu + 1.0) / mu * limit, 0.0, np.clip(partial, 0.0, 1.0)),
    )
    return weights
