# SPDX-License-Identifier: Apache-2.0
"""Losses of groups of constraints; graduated non-convexity. The table of losses is `Loss`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cartoloop.arrays import FloatArray
from cartoloop.kernels.pose_adjustment.layout import GroupLosses
from cartoloop.kernels.pose_adjustment.losses import Loss
from cartoloop.kernels.pose_adjustment.robust_loss import robust_loss


class GroupLoss(NamedTuple):
    """The loss of a group of constraints, and its scale in units of E; None for its default."""

    loss: Loss = Loss.NONE
    scale: float | None = None


def scale_of(loss: Loss, scale: float | None) -> float:
    """Return the scale of a loss: its default where none is given."""
    return loss.default_scale if scale is None else scale


def kernel_losses(losses: Sequence[GroupLoss]) -> GroupLosses:
    """Return the losses of all groups as kernels read them."""
    return GroupLosses(
        np.array([group.loss.code for group in losses], dtype=np.int64),
        np.array([scale_of(*group) for group in losses], dtype=np.float64),
    )


def loss_weights(squared: FloatArray, loss: Loss, scale: float | None = None) -> FloatArray:
    """Return the weight that a loss gives to constraints, in [0, 1]: rho' at E^2.

    Parameters
    ----------
    squared : E^2, shape (n,).
    loss, scale : the scale in units of E; None for the loss's default.
    """
    value = scale_of(loss, scale)
    weights = [robust_loss(loss.code, value, s)[1] for s in squared.tolist()]
    return np.array(weights, dtype=np.float64)


def initial_convexity(squared: FloatArray, scale: ArrayLike) -> float:
    """Return mu to start graduated non-convexity with: the loss is nearly convex for all residuals.

    Parameters
    ----------
    squared : E^2 of the constraints it acts on, at the least-squares solution, shape (n,), n > 0.
    scale : residual at which the loss is truncated, in units of E, one for all or shape (n,).

    Returns
    -------
    mu : positive; infinite if all residuals are within the scale: then the solution stands.
    """
    worst = float((squared / np.square(scale)).max())
    return 1.0 / (2.0 * worst - 1.0) if worst > 1.0 else np.inf


def truncated_weights(squared: FloatArray, scale: ArrayLike, mu: float) -> FloatArray:
    """Return the weights in [0, 1] of graduated non-convexity for truncated least squares.

    Yang et al., "Graduated Non-Convexity for Robust Spatial Perception" (2020), eq. 14; `squared`
    is E^2, shape (n,), and `mu` grows from near 0 (convex) to infinity (truncated).
    """
    limit = np.square(scale, dtype=np.float64)
    partial = (
        np.sqrt(limit) * np.sqrt(mu * (mu + 1.0) / np.maximum(squared, np.finfo(float).tiny)) - mu
    )
    weights: FloatArray = np.where(
        squared <= mu / (mu + 1.0) * limit,
        1.0,
        np.where(squared >= (mu + 1.0) / mu * limit, 0.0, np.clip(partial, 0.0, 1.0)),
    )
    return weights
