# SPDX-License-Identifier: Apache-2.0
"""The formulas of the robust losses; their names and scales are the table `Loss`."""

from __future__ import annotations

import math

from cartoloop._jit import kernel
from cartoloop.kernels.pose_adjustment.losses import Loss

_NONE = Loss.NONE.code
_HUBER = Loss.HUBER.code
_CAUCHY = Loss.CAUCHY.code
_DYNAMIC_COVARIANCE_SCALING = Loss.DYNAMIC_COVARIANCE_SCALING.code


@kernel
def robust_loss(code: int, scale: float, squared: float) -> tuple[float, float]:
    """Return rho and its derivative, the weight of the constraint, at s = E^2.

    Parameters
    ----------
    code : int64, of a :class:`~cartoloop.kernels.pose_adjustment.losses.Loss`.
    scale : float64 > 0, in units of the whitened residual E.
    squared : float64 >= 0, E^2.

    Notes
    -----
    Huber and Cauchy as in Ceres. Dynamic covariance scaling [16] is published as a weight only,
    (2 phi / (phi + s))^2 from s = phi = scale^2 on; rho is the integral of that weight, so that a
    step can be judged by the cost. Truncated least squares: rho = min(s, scale^2).
    """
    if code == _NONE:
        return squared, 1.0
    phi = scale * scale
    if code == _CAUCHY:
        ratio = squared / phi
        return phi * math.log1p(ratio), 1.0 / (1.0 + ratio)
    if squared <= phi:
        return squared, 1.0
    if code == _HUBER:
        root = math.sqrt(squared)
        return 2.0 * scale * root - phi, scale / root
    if code == _DYNAMIC_COVARIANCE_SCALING:
        switch = 2.0 * phi / (phi + squared)
        return phi * (3.0 - 2.0 * switch), switch * switch
    return phi, 0.0  # truncated: the end of graduated non-convexity
