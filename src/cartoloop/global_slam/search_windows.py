# SPDX-License-Identifier: Apache-2.0
"""The search window of a pair, from the length of the shortest path between the two."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import ConstraintSearchConfig


def windows(
    config: ConstraintSearchConfig, path_lengths: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the radii [m], [rad] of the search windows for path lengths [m], shape (n,)."""
    linear = config.min_linear_search_window + config.linear_drift * path_lengths
    angular_deg = config.min_angular_search_window_deg + config.angular_drift_deg * path_lengths
    return (
        np.minimum(linear, config.linear_search_window),
        np.radians(np.minimum(angular_deg, config.angular_search_window_deg)),
    )


def path_length_of(
    config: ConstraintSearchConfig, linear_window: float, angular_window: float
) -> float | None:
    """Return the path length that :func:`windows` made a search window of [m].

    None if the window is that of a wide search: it follows from the covariance of the drift.

    Parameters
    ----------
    linear_window, angular_window : radii [m], [rad].
    """
    drift = linear_window - config.min_linear_search_window
    length = drift / config.linear_drift if config.linear_drift else math.nan
    _, angular = windows(config, np.array((length,)))
    return None if abs(angular[0] - angular_window) > _ROUNDING else length


_ROUNDING = 1e-9
"""Largest difference between two windows of the same path length [rad]."""
