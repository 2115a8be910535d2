# SPDX-License-Identifier: Apache-2.0
"""The IMU: watched as its readings go by, then judged. One check a function."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field

import numpy as np

from cartoloop.doctor.findings import Finding, first_of
from cartoloop.sensor.events import Imu

ACCELERATION_LIMITS = (3.0, 30.0)
MEAN_LIMITS = (9.5, 10.5)
"""Between these, accelerations and their mean are those of an IMU that people or robots carry."""

MAX_GAP_S = 0.05
MAX_RATE = 35.0
"""No robot turns faster [rad/s]: the unit must be another."""

TILT_RAD = math.radians(15.0)


@dataclass(slots=True)
class ImuWatch:
    """Statistics of the IMU; memory grows by two numbers per reading.

    Attributes
    ----------
    name : of the topic.
    stamps, times : of each reading [s].
    sum_size : of the lengths of the accelerations [m/s^2]; `lowest`, `highest` of them.
    sums : of the accelerations x, y, z [m/s^2].
    num_odd, first_odd : accelerations outside the limits; stamp of the first.
    fastest_turn : largest angular velocity [rad/s].
    num_bad : readings that are not finite.
    """

    name: str = "imu"
    stamps: array[float] = field(default_factory=lambda: array("d"))
    times: array[float] = field(default_factory=lambda: array("d"))
    sum_size: float = 0.0
    lowest: float = math.inf
    highest: float = 0.0
    sums: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    num_odd: int = 0
    first_odd: float | None = None
    fastest_turn: float = 0.0
    num_bad: int = 0

    @property
    def count(self) -> int:
        """How many readings there were."""
        return len(self.stamps)

    @property
    def mean_size(self) -> float:
        """Mean length of the acceleration [m/s^2]."""
        return self.sum_size / max(self.count, 1)

    @property
    def tilt(self) -> float:
        """Angle between the mean acceleration and the z axis [rad]."""
        return math.atan2(math.hypot(self.sums[0], self.sums[1]), self.sums[2])

    def add(self, imu: Imu) -> None:
        """Take in a reading."""
        size = math.hypot(*imu.linear_acceleration)
        rate = math.hypot(*imu.angular_velocity)
        if not (math.isfinite(size) and math.isfinite(rate)):
            self.num_bad += 1
            return
        self.stamps.append(imu.stamp)
        self.times.append(imu.time)
        self.sum_size += size
        self.lowest, self.highest = min(self.lowest, size), max(self.highest, size)
        self.fastest_turn = max(self.fastest_turn, rate)
        for axis, value in enumerate(imu.linear_acceleration):
            self.sums[axis] += value
        if not ACCELERATION_LIMITS[0] <= size <= ACCELERATION_LIMITS[1]:
            self.num_odd += 1
            self.first_odd = first_of(self.first_odd, imu.stamp)


def check_imu(watch: ImuWatch) -> list[Finding]:
    """Return what is wrong with the IMU; nothing if there is none."""
    if watch.count == 0 and not watch.num_bad:
        return []
    found = (
        check_finite(watch),
        check_acceleration(watch),
        check_gravity(watch),
        check_tilt(watch),
        check_rate(watch),
        check_gaps(watch),
    )
    return [finding for finding in found if finding is not None]


def check_finite(watch: ImuWatch) -> Finding | None:
    """Readings that are no numbers."""
    if not watch.num_bad:
        return None
    return Finding(
        "warning",
        "imu_not_finite",
        f"{watch.num_bad} IMU readings are NaN or infinite",
        "they are skipped; check the IMU's driver",
        watch.name,
        watch.num_bad,
    )


def check_acceleration(watch: ImuWatch) -> Finding | None:
    """Single accelerations that are too small or too large."""
    if not watch.num_odd:
        return None
    low, high = ACCELERATION_LIMITS
    return Finding(
        "warning",
        "imu_acceleration",
        f"{watch.num_odd} of {watch.count} accelerations are outside {low:g} to {high:g} m/s^2 "
        f"({watch.lowest:.3g} to {watch.highest:.3g})",
        "gravity must be part of the acceleration, in m/s^2; check the IMU's driver and mounting",
        watch.name,
        watch.num_odd,
        watch.first_odd,
    )


def check_gravity(watch: ImuWatch) -> Finding | None:
    """A mean acceleration that is not gravity."""
    low, high = MEAN_LIMITS
    if watch.count == 0 or low <= watch.mean_size <= high:
        return None
    return Finding(
        "warning",
        "imu_gravity",
        f"the acceleration is {watch.mean_size:.2f} m/s^2 on average, not within {low} to {high}",
        "gravity must be part of the acceleration, in m/s^2; calibrate the IMU",
        watch.name,
        watch.count,
    )


def check_tilt(watch: ImuWatch) -> Finding | None:
    """Gravity that does not point down the tracking frame's z axis."""
    if watch.count == 0 or watch.tilt <= TILT_RAD:
        return None
    return Finding(
        "warning",
        "imu_tilted",
        f"gravity points {math.degrees(watch.tilt):.0f} degrees off the z axis on average",
        "the scanner is carried askew, or the transform to the IMU is wrong: correct it, or give "
        "--imu-topic none",
        watch.name,
        watch.count,
    )


def check_rate(watch: ImuWatch) -> Finding | None:
    """Angular velocities that cannot be in rad/s."""
    if watch.fastest_turn <= MAX_RATE:
        return None
    return Finding(
        "warning",
        "imu_rate",
        f"the angular velocity reaches {watch.fastest_turn:.0f} rad/s",
        "it must be in rad/s, not in degrees; check the IMU's driver",
        watch.name,
    )


def check_gaps(watch: ImuWatch) -> Finding | None:
    """Pauses during which the heading is not carried on."""
    steps = np.diff(np.asarray(watch.times))
    if not len(steps):
        return None
    limit = max(MAX_GAP_S, 3.0 * float(np.median(steps)))
    num_gaps, longest = int((steps > limit).sum()), int(np.argmax(steps))
    if not num_gaps:
        return None
    return Finding(
        "warning",
        "imu_gaps",
        f"{num_gaps} pauses are longer than {limit:.2g} s (up to {steps[longest]:.3g} s)",
        "record on a machine that keeps up, with all the IMU's messages",
        watch.name,
        num_gaps,
        watch.stamps[longest],
    )
