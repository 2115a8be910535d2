# SPDX-License-Identifier: Apache-2.0
"""How somebody who carries the scanners sways and leans while walking."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cartoloop.simulation.motion import Motion

FloatArray = NDArray[np.float64]

# Shares of the largest tilt, frequency [Hz] and phase: swaying with each stride (two steps) and
# with each step, and leaning slowly.
_ROLL_PARTS = ((0.55, 0.9, 0.0), (0.1, 1.8, 1.1), (0.35, 0.11, 0.4))
_PITCH_PARTS = ((0.1, 0.9, 2.0), (0.35, 1.8, 0.3), (0.55, 0.083, 1.3))


@dataclass(frozen=True, slots=True)
class Gait:
    """Roll and pitch over time; both stay within `tilt`.

    Attributes
    ----------
    tilt : the largest roll and pitch [rad]; 0: a robot that stays level.
    bounce : how far the body rises and sinks with each step [m]; it shows in the acceleration.
    start : when walking starts [s]; until then the body stands still and level.
    """

    tilt: float = 0.0
    bounce: float = 0.0
    start: float = 0.0

    def attitudes_at(self, times: FloatArray) -> FloatArray:
        """Return roll and pitch at `times` [s], shape (n, 2) [rad]."""
        columns = [
            sum(
                share * np.sin(math.tau * frequency * times + phase)
                for share, frequency, phase in parts
            )
            for parts in (_ROLL_PARTS, _PITCH_PARTS)
        ]
        swing: FloatArray = np.column_stack(columns)
        return self.tilt * self._vigour(times)[:, None] * swing

    def rise_at(self, times: FloatArray) -> FloatArray:
        """Return the height above the mean at `times` [s], shape (n,) [m]."""
        swing: FloatArray = np.sin(math.tau * 1.8 * times)
        return self.bounce * self._vigour(times) * swing

    def _vigour(self, times: FloatArray) -> FloatArray:
        """Return 0 while standing, 1 while walking, and what is between in the first second."""
        if self.start <= 0.0:
            return np.ones(len(times))
        share = np.clip(times - self.start, 0.0, 1.0)
        return share * share * (3.0 - 2.0 * share)


def body_poses(motion: Motion, gait: Gait, times: FloatArray) -> FloatArray:
    """Return x [m], y [m], theta, roll and pitch [rad] of the body at `times` [s], shape (n, 5)."""
    return np.column_stack((motion.poses_at(times), gait.attitudes_at(times)))


def turned(attitudes: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return vectors of the body's frame in that of the map.

    Parameters
    ----------
    attitudes : float64, shape (n, 3), roll, pitch, theta [rad] of the body.
    vectors : float64, shape (n, 3).
    """
    roll, pitch, theta = attitudes.T
    x, y, z = vectors.T
    y, z = np.cos(roll) * y - np.sin(roll) * z, np.sin(roll) * y + np.cos(roll) * z
    x, z = np.cos(pitch) * x + np.sin(pitch) * z, np.cos(pitch) * z - np.sin(pitch) * x
    x, y = np.cos(theta) * x - np.sin(theta) * y, np.sin(theta) * x + np.cos(theta) * y
    return np.column_stack((x, y, z))


def turned_back(attitudes: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return vectors of the map's frame in that of the body; parameters as `turned`."""
    roll, pitch, theta = attitudes.T
    x, y, z = vectors.T
    x, y = np.cos(theta) * x + np.sin(theta) * y, np.cos(theta) * y - np.sin(theta) * x
    x, z = np.cos(pitch) * x - np.sin(pitch) * z, np.cos(pitch) * z + np.sin(pitch) * x
    y, z = np.cos(roll) * y + np.sin(roll) * z, np.cos(roll) * z - np.sin(roll) * y
    return np.column_stack((x, y, z))
