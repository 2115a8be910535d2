# SPDX-License-Identifier: Apache-2.0
"""The readings of the odometry, packed, and without those that nothing asks for any more.

A robot that is on for days reports its odometry fifty times a second. What is asked of it are the
poses at scans: at the latest thousands, and at the ends of distances that were measured.
"""

from __future__ import annotations

import math
from array import array

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.sensor.pose import Pose, quick_pose

LATEST_S = 10.0
"""Time for which all latest readings are kept [s]: whether one is a jump, or repeats another, is
decided by the readings some seconds before."""

FEW = 20_000
"""Number of readings that are kept in any case: minutes of a fast odometry."""

MAX_GAP_S, GAP_PERIODS = 3.0, 6.0
"""Between readings further apart than the first [s], and than this many usual ones, the robot may
have driven anywhere: a driver has failed, and readings that were no numbers were left out."""


def are_measured(times: FloatArray, reading_times: FloatArray) -> BoolArray:
    """Return at which times the odometry is known: neither outside its readings nor in a gap.

    Parameters
    ----------
    times : float64, shape (n,) [s].
    reading_times : float64, shape (k,), increasing [s]; k > 1.
    """
    steps = np.diff(reading_times)
    longest = max(MAX_GAP_S, GAP_PERIODS * float(np.median(steps)))
    after = np.searchsorted(reading_times, times, side="right").clip(1, len(steps))
    known: BoolArray = (
        (times >= reading_times[0]) & (times <= reading_times[-1]) & (steps[after - 1] <= longest)
    )
    return known


class OdometryReadings:
    """Times, increasing, and poses; 40 bytes a reading.

    Attributes
    ----------
    times : of the readings [s]; to be read only.
    """

    def __init__(self) -> None:
        self.times = array("d")
        self._poses = array("d")
        self._turns = array("d")
        self._most = FEW

    def __len__(self) -> int:
        return len(self.times)

    def pose(self, row: int) -> Pose:
        """Return the pose of a reading, counted from the end if `row` is negative."""
        first = 3 * (row if row >= 0 else len(self.times) + row)
        numbers = self._poses
        return quick_pose((numbers[first], numbers[first + 1], numbers[first + 2]))

    def append(self, time: float, pose: Pose) -> None:
        """Add a reading that is newer than all others."""
        turns = -0.0  # changes no bit of the first heading
        if self._turns:
            turns = self._turns[-1] + _turn_between(self._poses[-1], pose.theta)
        self.times.append(time)
        self._poses.extend(pose)
        self._turns.append(turns)

    def pop(self) -> None:
        """Drop the latest reading."""
        self.times.pop()
        self._turns.pop()
        del self._poses[-3:]

    def rows(self) -> tuple[FloatArray, FloatArray]:
        """Return times and poses, whose headings are continuous, shapes (n,), (n, 3)."""
        poses = np.array(self._poses).reshape(-1, 3)
        poses[:, 2] += np.array(self._turns)
        return np.array(self.times), poses

    @property
    def are_many(self) -> bool:
        """Whether it is time to forget some."""
        return len(self.times) >= self._most

    def forget(self, needed: FloatArray, reach: float) -> None:
        """Forget all readings but the latest, those around some times, and one to each side.

        Poses around these times remain the same, to the last bit.

        Parameters
        ----------
        needed : the times [s], shape (n,).
        reach : that are kept before and after each [s].
        """
        times, poses = np.array(self.times), np.array(self._poses).reshape(-1, 3)
        is_kept = _around(times, needed, reach) | (times >= times[-1] - LATEST_S)
        is_kept[-2:] = True
        self.times = array("d", times[is_kept].tobytes())
        self._poses = array("d", poses[is_kept].tobytes())
        self._turns = array("d", np.array(self._turns)[is_kept].tobytes())
        self._most = max(FEW, 2 * len(self.times))


def _around(times: FloatArray, needed: FloatArray, reach: float) -> BoolArray:
    """Return which times, increasing, are within reach of a needed one, or the next ones beyond."""
    first = np.maximum(np.searchsorted(times, needed - reach, side="right") - 1, 0)
    after = np.searchsorted(times, needed + reach, side="left") + 1
    steps = np.bincount(first, minlength=len(times) + 2)
    steps -= np.bincount(np.minimum(after, len(times)), minlength=len(times) + 2)
    is_around: BoolArray = np.cumsum(steps)[: len(times)] > 0
    return is_around


def _turn_between(before: float, after: float) -> float:
    """Return what makes a heading [rad] the continuation of the one before, as `numpy.unwrap`."""
    change = after - before
    if abs(change) < math.pi:
        return 0.0
    shortest = (change + math.pi) % math.tau - math.pi
    if shortest == -math.pi and change > 0.0:
        shortest = math.pi
    return shortest - change
