# SPDX-License-Identifier: Apache-2.0
"""Gravity and heading from an IMU (section IV): roll, pitch and rotation of the robot.

The direction up is the mean of the acceleration over some seconds, rotated with the robot by the
gyroscope; the accelerations of steps and starts average out. The bias of the gyroscope is its mean
while the robot stands. About the horizontal axes it also follows from the direction up, which
drifts to one side of the acceleration if it is rotated by a biased gyroscope.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise
from typing import Any

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.sensor.events import Imu

Vector = tuple[float, float, float]

MAX_GAP_S = 0.5
"""Longest gap between readings across which the heading is known [s]."""

MAX_REACH_S = 0.15
"""Time for which the last angular velocity is extrapolated [s]: a few readings may be late."""

MAX_TILT_RAD = math.radians(50.0)
"""Largest plausible tilt of a robot; beyond it, the IMU is mounted wrongly or without gravity."""

GRAVITY_LIMITS = (6.0, 14.0)
"""Limits of a mean acceleration that is gravity [m/s^2]: 9.8 with errors of scale."""

MAX_BIAS = 0.1
"""Largest bias [rad/s]; a larger mean is a rotation of the robot."""

REST_S = 1.0
"""Time over which rest is detected [s]."""

REST_READINGS = 10
"""Least number of readings for their spread to mean anything."""

REST_SPREAD = 0.02
"""Largest standard deviation of the angular velocity at rest [rad/s]."""

REST_SHAKE = 0.03
"""Largest standard deviation of the acceleration at rest, as a share of its mean."""

BIAS_FROM_S = 2.0
"""Time after the start from which the drift of the direction up corrects the bias [s]."""

BIAS_DAMPING = 0.5
"""Gain of that correction: the loop of direction and bias is well damped."""

MEMORY = 60_000
"""Least number of readings that are kept: minutes of a fast IMU."""


class ImuTrack:
    """Roll, pitch and heading of the robot over time.

    Attributes
    ----------
    num_readings : number of readings added.
    gyro_bias : mean of the gyroscope at rest, x, y, z [rad/s].
    num_rests : number of times that the bias was measured at rest.
    max_tilt : the largest angle between the robot's z axis and up [rad].

    Parameters
    ----------
    gravity_time_constant : time over which the acceleration is averaged [s].
    """

    def __init__(self, gravity_time_constant: float) -> None:
        self._time_constant = gravity_time_constant
        self._times: list[float] = []
        self._rolls: list[float] = []
        self._pitches: list[float] = []
        self._headings: list[float] = []
        self._start = 0.0
        self._last_rate = 0.0
        self._heading_step = 0.0
        self._up: Vector = (0.0, 0.0, 1.0)
        self._has_gravity = False
        self._size = 0.0
        self._rest = _RestDetector()
        self.num_readings = 0
        self.gyro_bias: Vector = (0.0, 0.0, 0.0)
        self.num_rests = 0
        self.max_tilt = 0.0

    @property
    def measures_gravity(self) -> bool:
        """Whether the mean acceleration is gravity, as a standing robot measures it."""
        return self._has_gravity_size and _tilt(self._up) <= MAX_TILT_RAD

    @property
    def is_askew(self) -> bool:
        """Whether gravity has an implausible direction: an axis or a sign may be wrong."""
        return self._has_gravity_size and _tilt(self._up) > MAX_TILT_RAD

    @property
    def _has_gravity_size(self) -> bool:
        low, high = GRAVITY_LIMITS
        return self._has_gravity and low < self._size < high

    def summary(self) -> dict[str, Any]:
        """Return the estimates, for the report."""
        return {
            "readings": self.num_readings,
            "measures_gravity": self.measures_gravity,
            "max_tilt_rad": self.max_tilt,
            "gyro_bias_rad_s": list(self.gyro_bias),
            "rests": self.num_rests,
        }

    def add(self, imu: Imu) -> None:
        """Add a reading; one that is not newer than the last is ignored."""
        if self._times and imu.time <= self._times[-1]:
            return
        size = math.hypot(*imu.linear_acceleration)
        if not self._times:
            self._start = imu.time
            self._turn(imu, 0.0)
        elif imu.time - self._times[-1] > MAX_GAP_S:
            self._turn(imu, 0.0)
            self._rest = _RestDetector()
        else:
            self._turn(imu, imu.time - self._times[-1])
        if size > 0.0:
            self._lean(imu, size)
        self._note(imu)
        self.num_readings += 1

    def note_standing(self, stands: bool) -> None:
        """Add whether the robot stands according to the scans; only then the bias is measured."""
        self._rest.note(stands)

    def correct_bias(self, excess: float) -> None:
        """Correct the bias about gravity by an excess of the angular velocity [rad/s]."""
        x, y, z = self.gyro_bias
        self.gyro_bias = (x, y, _clipped(z + excess))

    def covers(self, begin: float, end: float) -> bool:
        """Return whether the heading is known from one time to another, later or equal."""
        times = self._times
        if not times or begin < times[0] or end > times[-1] + MAX_REACH_S:
            return False
        first, last = bisect_right(times, begin) - 1, bisect_right(times, end)
        around = times[first : last + 1]
        return all(b - a <= MAX_GAP_S for a, b in pairwise(around))

    def at(self, times: FloatArray) -> FloatArray:
        """Return roll, pitch and heading at `times` [s], shape (n, 3) [rad].

        Before the first reading they are those of the first; after the last the heading is
        extrapolated. The heading is not wrapped; only its differences have a meaning.
        """
        first = max(bisect_right(self._times, float(times.min())) - 1, 0)
        last = bisect_right(self._times, float(times.max())) + 1
        own = self._times[first:last]
        columns = [
            np.interp(times, own, values[first:last])
            for values in (self._rolls, self._pitches, self._headings)
        ]
        beyond = np.clip(times - self._times[-1], 0.0, MAX_REACH_S)
        columns[2] += beyond * self._last_rate
        return np.column_stack(columns)

    def headings(self) -> tuple[FloatArray, FloatArray]:
        """Return times [s] and headings [rad], shapes (n,), of the stored readings."""
        return np.array(self._times), np.array(self._headings)

    def _turn(self, imu: Imu, duration: float) -> None:
        """Rotate the direction up, fixed in the world, against the robot; integrate the heading."""
        rx, ry, rz = (
            rate - bias for rate, bias in zip(imu.angular_velocity, self.gyro_bias, strict=True)
        )
        self._up = _turned(self._up, (-rx * duration, -ry * duration, -rz * duration))
        # Without gravity the robot is assumed level.
        roll, pitch = _roll_and_pitch(self._up) if self._has_gravity_size else (0.0, 0.0)
        # The rate of the yaw angle of Rz(yaw) Ry(pitch) Rx(roll).
        rate = (ry * math.sin(roll) + rz * math.cos(roll)) / max(math.cos(pitch), 0.1)
        self._heading_step = 0.5 * (rate + self._last_rate) * duration
        self._last_rate = rate

    def _lean(self, imu: Imu, size: float) -> None:
        """Move the direction up towards the acceleration, and the bias towards what explains it."""
        x, y, z = (part / size for part in imu.linear_acceleration)
        if not self._has_gravity:
            self._up, self._has_gravity, self._size = (x, y, z), True, size
            return
        duration = min(imu.time - self._times[-1], MAX_GAP_S)
        elapsed = imu.time - self._start
        constant = min(self._time_constant, max(elapsed, duration))
        share = 1.0 - math.exp(-duration / constant)
        self._size += share * (size - self._size)
        ux, uy, uz = self._up
        off = (uy * z - uz * y, uz * x - ux * z, ux * y - uy * x)
        self._up = _unit(ux + share * (x - ux), uy + share * (y - uy), uz + share * (z - uz))
        if elapsed > BIAS_FROM_S:
            gain = BIAS_DAMPING * duration / constant**2
            bx, by, bz = self.gyro_bias
            self.gyro_bias = (_clipped(bx + gain * off[0]), _clipped(by + gain * off[1]), bz)

    def _note(self, imu: Imu) -> None:
        roll, pitch = _roll_and_pitch(self._up)
        heading = self._headings[-1] + self._heading_step if self._times else 0.0
        self._times.append(imu.time)
        self._rolls.append(roll)
        self._pitches.append(pitch)
        self._headings.append(heading)
        if self._has_gravity_size:
            self.max_tilt = max(self.max_tilt, _tilt(self._up))
        if len(self._times) >= 2 * MEMORY:
            for values in (self._times, self._rolls, self._pitches, self._headings):
                del values[:MEMORY]
        bias = self._rest.add(imu)
        if bias is not None and max(map(abs, bias)) <= MAX_BIAS:
            self.num_rests += 1
            self.gyro_bias = bias


class _RestDetector:
    """Finds the mean angular velocity over a time of rest."""

    def __init__(self) -> None:
        self._begin = math.nan
        self._rates: list[Vector] = []
        self._sizes: list[float] = []
        self._stands = True

    def note(self, stands: bool) -> None:
        """Add whether the robot stands according to the scans."""
        self._stands = self._stands and stands

    def add(self, imu: Imu) -> Vector | None:
        """Add a reading; return the mean angular velocity at the end of a time of rest."""
        if not self._rates:
            self._begin = imu.time
        self._rates.append(imu.angular_velocity)
        self._sizes.append(math.hypot(*imu.linear_acceleration))
        if imu.time - self._begin < REST_S:
            return None
        rates, sizes, stood = np.array(self._rates), np.array(self._sizes), self._stands
        self._rates, self._sizes, self._stands = [], [], True
        if not stood or len(rates) < REST_READINGS or rates.std(axis=0).max() > REST_SPREAD:
            return None
        if sizes.std() > REST_SHAKE * sizes.mean():
            return None
        x, y, z = rates.mean(axis=0).tolist()
        return (x, y, z)


def _roll_and_pitch(up: Vector) -> tuple[float, float]:
    """Return roll and pitch [rad], given the direction up in the tracking frame."""
    x, y, z = up
    return math.atan2(y, z), math.atan2(-x, math.hypot(y, z))


def _tilt(up: Vector) -> float:
    return math.acos(min(max(up[2], -1.0), 1.0))


def _clipped(bias: float) -> float:
    return min(max(bias, -MAX_BIAS), MAX_BIAS)


def _unit(x: float, y: float, z: float) -> Vector:
    size = math.sqrt(x * x + y * y + z * z)
    return (x / size, y / size, z / size) if size > 1e-9 else (0.0, 0.0, 1.0)


def _turned(vector: Vector, by: Vector) -> Vector:
    """Return a unit vector after a rotation by the vector `by` [rad] (Rodrigues)."""
    angle = math.sqrt(by[0] * by[0] + by[1] * by[1] + by[2] * by[2])
    if angle < 1e-12:
        return vector
    kx, ky, kz = by[0] / angle, by[1] / angle, by[2] / angle
    x, y, z = vector
    cos, sin = math.cos(angle), math.sin(angle)
    along = (kx * x + ky * y + kz * z) * (1.0 - cos)
    return _unit(
        x * cos + (ky * z - kz * y) * sin + kx * along,
        y * cos + (kz * x - kx * z) * sin + ky * along,
        z * cos + (kx * y - ky * x) * sin + kz * along,
    )
