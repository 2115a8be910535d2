# SPDX-License-Identifier: Apache-2.0
"""Clock offset of the IMU, and whether its gyroscope agrees with the matched scans."""

from __future__ import annotations

from typing import Any

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.local_slam.clock_offset import (
    FIRST_ESTIMATE,
    MIN_TURN_RAD,
    clock_offset,
    next_estimate,
)
from cartoloop.sensor.imu_track import ImuTrack
from cartoloop.sensor.pose import Pose, wrap_angle, wrap_angles

MIN_TURNS = 25
"""Number of turning steps needed to estimate the offset."""

MIN_OFFSET_S = 0.015
"""A smaller offset counts as none [s]: less than a step of the search."""

MAX_UNEXPLAINED = 0.4
"""Largest share of the turns that the gyroscope may miss; else it is broken or mounted wrongly."""

MIN_STEP_S = 0.15
"""Least time between the scans that are used [s]: shorter steps turn too little."""

WINDOW = 1500
"""Number of latest scans that are used: some minutes, so that a drifting clock is followed."""

UNKNOWN_BIAS, REST_BIAS_ERROR = 0.02, 0.0005
"""Standard deviations of the bias about gravity before anything measures it, and when it has been
measured at rest [rad/s]."""

BIAS_DRIFT = 3e-5
"""Standard deviation by which the bias changes in a second [rad/s]: by 0.0005 in five minutes."""

FIRST_NOISE_RAD, LEAST_NOISE_RAD, NOISE_MEMORY = 0.005, 0.001, 0.98
"""Standard deviation of the difference between scans and gyroscope in a step, at first and at least
[rad], and the share of its square that is kept from scan to scan."""

FOLLOWING = 10.0
"""Factor of that square, since matches follow the gyroscope in part, and then confirm its bias."""

MAX_BIAS_STEP_RAD = 0.03
"""A larger difference between gyroscope and scans in one step is an outlier [rad]."""


class ImuCalibration:
    """Compares the headings of matched scans with those of the gyroscope.

    Attributes
    ----------
    time_offset : IMU readings of a stamp show the robot this much later than the scan of it [s].
    is_measured : whether the robot has turned enough to compare them.
    agrees : whether the gyroscope turns as the scans do; False where an axis or a sign is wrong.
    """

    def __init__(self) -> None:
        self.time_offset = 0.0
        self.is_measured = False
        self.agrees = True
        self._times: list[float] = []
        self._headings: list[float] = []
        self._last: tuple[float, float] | None = None
        self._bias_variance, self._num_rests = UNKNOWN_BIAS**2, 0
        self._noise_variance = FIRST_NOISE_RAD**2
        self._num_kept = 0
        self._due = FIRST_ESTIMATE

    def summary(self) -> dict[str, Any]:
        """Return the estimates, for the report."""
        return {
            "measures_heading": self.agrees,
            "time_offset_s": self.time_offset if self.is_measured else None,
        }

    def add(self, time: float, pose: Pose, track: ImuTrack) -> None:
        """Add a scan's pose as matched; from time to time, estimate again."""
        if self._last is not None:
            self._correct_bias(time, pose.theta, *self._last, track)
        self._last = (time, pose.theta)
        if self._times and time - self._times[-1] < MIN_STEP_S:
            return
        self._times.append(time)
        self._headings.append(pose.theta)
        self._num_kept += 1
        if self._num_kept >= self._due:
            self._due = next_estimate(self._num_kept)
            del self._times[:-WINDOW], self._headings[:-WINDOW]
            self._estimate(np.array(self._times), np.array(self._headings), track)

    def skip(self) -> None:
        """Note a scan that was not matched: the next step does not begin at the last one."""
        self._last = None

    def _correct_bias(
        self, time: float, heading: float, last_time: float, last_heading: float, track: ImuTrack
    ) -> None:
        """Correct the bias by what the gyroscope turned more than a scan: a Kalman filter.

        The noisier the headings of the scans are, the longer they are averaged.
        """
        before, now = last_time - self.time_offset, time - self.time_offset
        if not (self.agrees and now > before and track.covers(before, now)):
            return
        turned = track.at(np.array((before, now)))[:, 2]
        excess = wrap_angle(float(turned[1] - turned[0]) - (heading - last_heading))
        if abs(excess) >= MAX_BIAS_STEP_RAD:
            return
        if track.num_rests != self._num_rests:
            self._num_rests, self._bias_variance = track.num_rests, REST_BIAS_ERROR**2
        self._bias_variance += BIAS_DRIFT**2 * (now - before)
        self._noise_variance += (1.0 - NOISE_MEMORY) * (excess**2 - self._noise_variance)
        noise = FOLLOWING * max(self._noise_variance, LEAST_NOISE_RAD**2) / (now - before) ** 2
        gain = self._bias_variance / (self._bias_variance + noise)
        self._bias_variance *= 1.0 - gain
        track.correct_bias(gain * excess / (now - before))

    def _estimate(self, times: FloatArray, headings: FloatArray, track: ImuTrack) -> None:
        reading_times, reading_headings = track.headings()
        turns = wrap_angles(np.diff(headings))
        known = (times >= reading_times[0]) & (times <= reading_times[-1])
        turning = (np.abs(turns) > MIN_TURN_RAD) & known[:-1] & known[1:]
        if np.count_nonzero(turning) < MIN_TURNS:
            return
        found = clock_offset(
            times,
            turns,
            turning,
            reading_times,
            reading_headings,
            MAX_UNEXPLAINED,
            self.time_offset,
        )
        self.is_measured = True
        self.agrees = found is not None
        if found is not None:
            self.time_offset = found.offset if abs(found.offset) >= MIN_OFFSET_S else 0.0
