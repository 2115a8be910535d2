# SPDX-License-Identifier: Apache-2.0
"""Points of a scan in another frame."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray


@kernel
def moved_points(x: float, y: float, theta: float, points_b: FloatArray) -> FloatArray:
    """Return points in frame a, as `cartoloop.sensor.pose.transform_points` does for any array.

    Parameters
    ----------
    x, y, theta : tf_a_b [m, m, rad].
    points_b : float64, shape (n, 2), frame b [m].
    """
    cos, sin = math.cos(theta), math.sin(theta)
    points_a = np.empty((points_b.shape[0], 2))
    for k in range(points_b.shape[0]):
        points_a[k, 0] = x + cos * points_b[k, 0] - sin * points_b[k, 1]
        points_a[k, 1] = y + sin * points_b[k, 0] + cos * points_b[k, 1]
    return points_a
