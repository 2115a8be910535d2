# SPDX-License-Identifier: Apache-2.0
"""How the robot moves and tilts while a scanner sweeps, and how a scanner is mounted in space."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.kernels.sweep_projection import place_upright
from cartoloop.sensor.events import CloudGeometry, ScanGeometry
from cartoloop.sensor.pose import FloatArray, Pose


class SweepMotion(NamedTuple):
    """The robot during a sweep, at moments equally far apart.

    Attributes
    ----------
    start : the first moment, from the time of the scan on [s].
    step : from one to the next [s], positive.
    knots : float64, shape (k, 5): where the robot is at each, seen from where it is at the time of
        the scan, x, y [m], theta [rad], and its roll and pitch [rad].
    """

    start: float
    step: float
    knots: FloatArray


AT_REST = SweepMotion(0.0, 1.0, np.zeros((1, 5)))
"""A level robot that stands still."""


def rotation(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Return Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3); angles in radians."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
    )


def is_level(geometry: ScanGeometry | CloudGeometry) -> bool:
    """Return whether the scanner sits level on the robot."""
    return geometry.roll == 0.0 and geometry.pitch == 0.0


def sensor_in_sweep(mounting: Pose, height: float, motion: SweepMotion) -> Pose:
    """Return where a sensor stands in the middle of a sweep.

    Parameters
    ----------
    mounting, height : where it sits on the robot; the height in metres.
    motion : during the sweep.

    Returns
    -------
    The pose in the robot's level frame at the time of the scan.
    """
    middle = motion.start + 0.5 * (len(motion.knots) - 1) * motion.step
    x, y, _ = place_upright(mounting.x, mounting.y, height, middle, *motion)
    turned = motion.knots[len(motion.knots) // 2, 2]
    return Pose(x, y, mounting.theta + float(turned))
