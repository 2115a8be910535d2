# SPDX-License-Identifier: Apache-2.0
"""Gravity and heading from an IMU (section IV): which way is up, and how the robot turned.

Up is the mean of the acceleration over some seconds, turned along with the robot by what the
gyroscope tells; the acceleration of a step or of a start averages out. The gyroscope's bias is its
mean while the robot stands; about the horizontal axes it also shows in that up, as the gyroscope
turns it, keeps drifting off to one side of the acceleration.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise

import numpy as np

from cartoloop.sensor.events import Imu
from cartoloop.sensor.pose import FloatArray

Vector = tuple[float, float, float]

MAX_GAP_S = 0.5
"""Across a longer gap between readings nothing is known of the heading."""

MAX_REACH_S = 0.15
"""The last reading is taken to hold for so long."""

MAX_TILT_RAD = math.radians(50.0)
"""A robot that seems more tilted is not: its IMU is turned, or tells no gravity."""

GRAVITY_LIMITS = (6.0, 14.0)
"""An acceleration that is shorter or longer on average is not that of gravity [m/s^2]."""

MAX_BIAS = 0.1
"""A larger bias is a motion [rad/s]."""

REST_S = 1.0
"""Rest shows in so long a time."""

REST_SPREAD = 0.02
"""Standard deviation of the angular velocity below which the robot stands [rad/s]."""

REST_SHAKE = 0.03
"""And that of the acceleration, as a share of it."""

BIAS_FROM_S = 2.0
"""So long after the start, that up drifts off begins to tell of the bias."""

MEMORY = 60_000
"""How many readings are kept at least: minutes, of a fast IMU."""


class ImuTrack:
    """Roll, pitch and heading of the robot over time.

    Attributes
    ----------
    num_readings : how many were taken in.
    gyro_bias : what the gyroscope tells at rest, x, y, z [rad/s].
    num_rests : how often the robot stood and the bias was measured.
    max_tilt : the largest angle between the robot's z axis and up [rad].

    Parameters
    ----------
    gravity_time_constant : the acceleration is averaged over about so long [s].
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
    def tells_gravity(self) -> bool:
        """Whether the acceleration is one that a robot on its feet feels."""
        return self._feels_gravity and _tilt(self._up) <= MAX_TILT_RAD

    @property
    def is_askew(self) -> bool:
        """Whether gravity comes from elsewhere than below: an axis or a sign may be wrong."""
        return self._feels_gravity and _tilt(self._up) > MAX_TILT_RAD

    @property
    def _feels_gravity(self) -> bool:
        low, high = GRAVITY_LIMITS
        return self._has_gravity and low < self._size < high

    def add(self, imu: Imu) -> None:
        """Take in a reading; one that is not newer than the last is left out."""
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
        """Take in whether the scans tell that the robot stands; what is no rest is no bias."""
        self._rest.note(stands)

    def correct_bias(self, excess: float) -> None:
        """Take in by how much the turning rate about gravity is too large [rad/s]."""
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

        Before the first reading they are those of the first; after the last the heading goes on.
        The heading is not wrapped; only its differences mean anything.
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
        """Return times [s] and headings [rad], shapes (n,), of the readings that are kept."""
        return np.array(self._times), np.array(self._headings)

    def _turn(self, imu: Imu, duration: float) -> None:
        """Turn up, which stands still, against the robot, and the heading with it."""
        rx, ry, rz = (
            rate - bias for rate, bias in zip(imu.angular_velocity, self.gyro_bias, strict=True)
        )
        self._up = _turned(self._up, (-rx * duration, -ry * duration, -rz * duration))
        # Without gravity up is nowhere, and the IMU is taken to be level.
        roll, pitch = _roll_and_pitch(self._up) if self._feels_gravity else (0.0, 0.0)
        # The rate of the yaw angle of Rz(yaw) Ry(pitch) Rx(roll).
        rate = (ry * math.sin(roll) + rz * math.cos(roll)) / max(math.cos(pitch), 0.1)
        self._heading_step = 0.5 * (rate + self._last_rate) * duration
        self._last_rate = rate

    def _lean(self, imu: Imu, size: float) -> None:
        """Move up towards the acceleration, and the bias towards what explains the way there."""
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
            # Well damped: up alone decays with the constant, as far as that has grown.
            gain = 0.5 * duration / constant**2
            bx, by, bz = self.gyro_bias
            self.gyro_bias = (_clipped(bx + gain * off[0]), _clipped(by + gain * off[1]), bz)

    def _note(self, imu: Imu) -> None:
        roll, pitch = _roll_and_pitch(self._up)
        heading = self._headings[-1] + self._heading_step if self._times else 0.0
        self._times.append(imu.time)
        self._rolls.append(roll)
        self._pitches.append(pitch)
        self._headings.append(heading)
        if self._feels_gravity:
            self.max_tilt = max(self.max_tilt, _tilt(self._up))
        if len(self._times) >= 2 * MEMORY:
            for values in (self._times, self._rolls, self._pitches, self._headings):
                del values[:MEMORY]
        bias = self._rest.add(imu)
        if bias is not None and max(map(abs, bias)) <= MAX_BIAS:
            self.num_rests += 1
            self.gyro_bias = bias


class _RestDetector:
    """Finds the mean angular velocity of a while in which nothing moved."""

    def __init__(self) -> None:
        self._begin = math.nan
        self._rates: list[Vector] = []
        self._sizes: list[float] = []
        self._stands = True

    def note(self, stands: bool) -> None:
        self._stands = self._stands and stands

    def add(self, imu: Imu) -> Vector | None:
        """Return the mean angular velocity when a while of rest is over."""
        if not self._rates:
            self._begin = imu.time
        self._rates.append(imu.angular_velocity)
        self._sizes.append(math.hypot(*imu.linear_acceleration))
        if imu.time - self._begin < REST_S:
            return None
        rates, sizes, stood = np.array(self._rates), np.array(self._sizes), self._stands
        self._rates, self._sizes, self._stands = [], [], True
        if not stood or len(rates) < 10 or rates.std(axis=0).max() > REST_SPREAD:
            return None
        if sizes.std() > REST_SHAKE * sizes.mean():
            return None
        x, y, z = rates.mean(axis=0).tolist()
        return (x, y, z)


def _roll_and_pitch(up: Vector) -> tuple[float, float]:
    """Return roll and pitch [rad] of a robot that sees up in this direction."""
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
