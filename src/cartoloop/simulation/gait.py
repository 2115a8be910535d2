# SPDX-License-Identifier: Apache-2.0
"""Roll and pitch of a person who carries the scanners while walking."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.simulation.motion import Motion

STEP_RATE = 1.8
"""Steps per second of a walking person [Hz]; a stride is two steps."""

_ROLL_PARTS = ((0.55, STEP_RATE / 2, 0.0), (0.1, STEP_RATE, 1.1), (0.35, 0.11, 0.4))
_PITCH_PARTS = ((0.1, STEP_RATE / 2, 2.0), (0.35, STEP_RATE, 0.3), (0.55, 0.083, 1.3))
"""Parts of roll and pitch: share of the tilt, frequency [Hz], phase [rad]. They sway with each
stride and each step, and lean slowly."""


@dataclass(frozen=True, slots=True)
class Gait:
    """Roll and pitch over time; both stay within `tilt`.

    Attributes
    ----------
    tilt : the largest roll and pitch [rad]; 0: a robot that stays level.
    bounce : amplitude of the vertical motion of each step [m]; it affects the acceleration.
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
        return self.tilt * self._activity(times)[:, None] * swing

    def rise_at(self, times: FloatArray) -> FloatArray:
        """Return the height above the mean at `times` [s], shape (n,) [m]."""
        swing: FloatArray = np.sin(math.tau * STEP_RATE * times)
        return self.bounce * self._activity(times) * swing

    def _activity(self, times: FloatArray) -> FloatArray:
        """Return 0 while standing, 1 while walking, with a smooth transition of one second."""
        if self.start <= 0.0:
            return np.ones(len(times))
        share = np.clip(times - self.start, 0.0, 1.0)
        return share * share * (3.0 - 2.0 * share)


def body_poses(motion: Motion, gait: Gait, times: FloatArray) -> FloatArray:
    """Return x [m], y [m], theta, roll and pitch [rad] of the body at `times` [s], shape (n, 5)."""
    return np.column_stack((motion.poses_at(times), gait.attitudes_at(times)))


def turned(attitudes: FloatArray, vectors: FloatArray) -> FloatArray:
    """Rotate vectors from the body frame to the map frame.

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
    """Rotate vectors from the map frame to the body frame; parameters as `turned`."""
    roll, pitch, theta = attitudes.T
    x, y, z = vectors.T
    x, y = np.cos(theta) * x + np.sin(theta) * y, np.cos(theta) * y - np.sin(theta) * x
    x, z = np.cos(pitch) * x - np.sin(pitch) * z, np.cos(pitch) * z + np.sin(pitch) * x
    y, z = np.cos(roll) * y + np.sin(roll) * z, np.cos(roll) * z - np.sin(roll) * y
    return np.column_stack((x, y, z))
