# SPDX-License-Identifier: Apache-2.0
"""The motion prior of a scan: a predicted pose and its uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.local_slam.gap import Gap
from cartoloop.sensor.pose import Pose


class Prediction(NamedTuple):
    """The motion prior of a scan: all that the scan matcher needs besides scan and submap.

    Attributes
    ----------
    tf_local_tracking : predicted pose.
    by_odometry : whether it is predicted by odometry; by constant velocity otherwise.
    information : float64, shape (6,), information matrix of the pose, upper triangle (xx, xy, xt,
        yy, yt, tt).
    fallbacks : returns other poses to try if the prediction fails: at rest and at constant
        velocity. Valid until the pose of the scan is added.
    stands : whether the odometry reports no motion at all, also before it is known to work.
    over_jump : pose by odometry that jumped, as it was reported; None if it did not jump.
    is_far : whether the odometry reports a step after which scans overlap so little that least
        squares may end in a wrong minimum, though not in a poor one.
    gap : of the recording right before the scan; None where there was none.
    """

    tf_local_tracking: Pose
    by_odometry: bool
    information: FloatArray
    fallbacks: Callable[[], tuple[Pose, Pose]]
    stands: bool = False
    over_jump: Pose | None = None
    is_far: bool = False
    gap: Gap | None = None


def isotropic_information(translation_sigma: float, rotation_sigma: float) -> FloatArray:
    """Return an information matrix as its upper triangle (xx, xy, xt, yy, yt, tt), shape (6,)."""
    translation, rotation = 1.0 / translation_sigma**2, 1.0 / rotation_sigma**2
    return np.array((translation, 0.0, 0.0, translation, 0.0, rotation))


def with_rotation_sigma(information: FloatArray, rotation_sigma: float) -> FloatArray:
    """Return such a matrix with a standard deviation of the rotation [rad], or a smaller one."""
    stiff = information.copy()
    stiff[5] = max(float(stiff[5]), rotation_sigma**-2)
    return stiff
