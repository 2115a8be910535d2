# SPDX-License-Identifier: Apache-2.0
"""A scan as lines between the ends of neighbouring beams."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.kernels.outline_lines import trace_outline
from cartoloop.sensor.pose import Pose, inverse


class Outline(NamedTuple):
    """A scan in the frame of its scanner; lines connect the ends of neighbouring beams.

    Attributes
    ----------
    bearings : float64, (n,), ascending [rad].
    points : float64, (n, 2), ends of the beams [m].
    """

    bearings: FloatArray
    points: FloatArray


def outline_of(returns: FloatArray, tf_tracking_sensor: Pose) -> Outline:
    """Return the outline of a scan.

    Parameters
    ----------
    returns : shape (n, 2), tracking frame [m].
    """
    bearings, points = np.empty(len(returns)), np.empty((len(returns), 2))
    if not trace_outline(returns, inverse(tf_tracking_sensor)[:], bearings, points):
        order = np.argsort(bearings, kind="stable")
        bearings, points = bearings[order], points[order]
    return Outline(bearings, points)
