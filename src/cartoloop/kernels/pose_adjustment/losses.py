# SPDX-License-Identifier: Apache-2.0
"""The robust losses of pose adjustment: the one table of them.

A new loss is one row here and its formula in :func:`cartoloop.kernels.pose_adjustment.robust_loss`.
Free of the compiler, so that the configuration can name the losses at no cost.
"""

from __future__ import annotations

from enum import StrEnum


class Loss(StrEnum):
    """A loss rho of eq. (SPA): its name and its default scale.

    The scale is where the loss begins to limit a constraint's influence, in units of the whitened
    residual E. A loss must be concave in E^2: then the weighted quadratic model of a constraint is
    nowhere below the loss, and a step that lowers the model lowers the cost.

    Attributes
    ----------
    default_scale : in units of E.
    code : the number by which kernels know the loss: its row in this table.
    """

    NONE = "none", 1.0
    """Plain least squares; the scale has no effect."""
    HUBER = "huber", 3.0
    """The paper's: the influence of a constraint stays constant beyond the scale. Convex."""
    CAUCHY = "cauchy", 3.0
    """The influence decreases as 1 / E."""
    DYNAMIC_COVARIANCE_SCALING = "dynamic_covariance_scaling", 3.0
    """The influence decreases as 1 / E^3 (Agarwal et al., the paper's [16])."""
    GRADUATED_NON_CONVEXITY = "graduated_non_convexity", 6.0
    """Truncated least squares: constraints are in or out, decided gradually (Yang et al., 2020).

    0.1 % of true constraints would lie beyond E = 4 (chi square, three degrees of freedom) if the
    informations of matches were right. They leave out how submaps are distorted.
    """
    TRUNCATED = "truncated", 10.0
    """The same from where Huber's loss ends: what is far from there is out.

    True constraints lie far beyond E = 4 where submaps are distorted and a loop has just closed.
    """

    default_scale: float
    code: int

    def __new__(cls, name: str, default_scale: float) -> Loss:
        """Make one row of the table."""
        row = str.__new__(cls, name)
        row._value_ = name
        row.default_scale = default_scale
        row.code = len(cls.__members__)
        return row


DECIDED = frozenset({Loss.GRADUATED_NON_CONVEXITY, Loss.TRUNCATED})
"""Losses of constraints that are in or out."""

FIXED_WEIGHTS = len(Loss)
"""Code of a group of constraints whose weights are set by the caller instead of a loss."""
