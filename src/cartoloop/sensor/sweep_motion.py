# SPDX-License-Identifier: Apache-2.0
"""The motion of the robot during a sweep, and the pose of a scanner in space."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.kernels.sweep_projection import SweepMotion, place_upright
from cartoloop.sensor.pose import Pose

__all__ = ["AT_REST", "SweepMotion", "rotation", "sensor_in_sweep"]

AT_REST = SweepMotion(0.0, 1.0, np.zeros((1, 5)))
"""A level robot at rest."""


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


def sensor_in_sweep(mounting: Pose, height: float, motion: SweepMotion) -> Pose:
    """Return the pose of a sensor in the middle of a sweep.

    Parameters
    ----------
    mounting, height : its pose on the robot, and height [m].
    motion : during the sweep.

    Returns
    -------
    The pose in the robot's level frame at the time of the scan.
    """
    middle = motion.start + 0.5 * (len(motion.knots) - 1) * motion.step
    x, y, _ = place_upright(mounting.x, mounting.y, height, middle, motion)
    turned = motion.knots[len(motion.knots) // 2, 2]
    return Pose(x, y, mounting.theta + float(turned))
