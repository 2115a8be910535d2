# SPDX-License-Identifier: Apache-2.0
"""The rotation between two times as the gyroscope of an IMU measured it."""

from __future__ import annotations

from typing import Any

import numpy as np

from cartoloop.local_slam.imu_calibration import ImuCalibration
from cartoloop.sensor.events import Imu
from cartoloop.sensor.imu_track import ImuTrack
from cartoloop.sensor.pose import Pose


class Gyroscope:
    """The readings of an IMU, compared with matched scans.

    Parameters
    ----------
    gravity_time_constant : of the direction up [s].

    Attributes
    ----------
    track : readings of the IMU; None without any.
    calibration : clock offset and plausibility of the gyroscope.
    """

    def __init__(self, gravity_time_constant: float) -> None:
        self._gravity_time_constant = gravity_time_constant
        self.track: ImuTrack | None = None
        self.calibration = ImuCalibration()

    def summary(self) -> dict[str, Any]:
        """Return its estimates, for the report; empty without readings."""
        if self.track is None:
            return {}
        return {"imu": self.track.summary() | self.calibration.summary()}

    def add(self, imu: Imu) -> None:
        """Add an inertial reading."""
        if self.track is None:
            self.track = ImuTrack(self._gravity_time_constant)
        self.track.add(imu)

    def add_pose(self, time: float, pose: Pose, *, is_matched: bool, may_stand: bool) -> None:
        """Add a scan's pose; `may_stand`: it does not contradict a robot at rest.

        One that was not matched follows the gyroscope, and says nothing about it.
        """
        if self.track is None:
            return
        self.track.note_standing(may_stand)
        if is_matched:
            self.calibration.add(time, pose, self.track)
        else:
            self.calibration.skip()

    def with_turn(self, step: Pose, begin: float, end: float) -> Pose:
        """Return a step with the rotation that the gyroscope measured, if it did."""
        turn = self.turn(begin, end)
        return step if turn is None else Pose(step.x, step.y, turn)

    def turn(self, begin: float, end: float) -> float | None:
        """Return the rotation [rad] that it measured between two times, or None."""
        if self.track is None or not self.calibration.agrees:
            return None
        # Upside down, or with a wrong sign: not used before it is compared with matched scans.
        if self.track.is_askew and not self.calibration.is_measured:
            return None
        begin -= self.calibration.time_offset
        end -= self.calibration.time_offset
        if not self.track.covers(min(begin, end), max(begin, end)):
            return None
        turned = self.track.at(np.array((begin, end)))[:, 2]
        return float(turned[1] - turned[0])
