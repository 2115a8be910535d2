# SPDX-License-Identifier: Apache-2.0
"""Wheel odometry as a continuous motion: poses between and shortly beyond the readings."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from itertools import chain

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.sensor.pose import (
    IDENTITY,
    Pose,
    compose,
    interpolate,
    inverse,
    wrap_angle,
)

MAX_EXTRAPOLATION_S = 0.5
"""Longest time after the last reading over which the motion is extrapolated [s]: a few readings
may be late, but wheels that send nothing have not stopped."""

MAX_PERIOD_S, MAX_HOLD_SHARE = 1.0, 0.05
"""Readings further apart than the first [s] do not determine a speed. The robot is then assumed at
the last reading, for a time that is this share of the time between them."""

MAX_STEP_M, MAX_SPEED = 1.0, 10.0
"""A step longer than MAX_STEP_M + MAX_SPEED * duration [m], [m/s] is a reset of the odometry, since
no robot on wheels is so fast."""

MAX_STEP_RAD, MAX_TURN_RATE = 1.0, 10.0
"""The same for the heading [rad], [rad/s]."""


class OdometryTrack:
    """The odometry readings so far, by their time.

    A jump further than a robot can move is a reset: the track continues from its last pose, as if
    the robot had not moved. The motion across a jump is not known: see `jumps_between`.
    """

    def __init__(self) -> None:
        self._jump_times: list[float] = []
        self._tf_track_odom = IDENTITY
        self._times: list[float] = []
        self._poses: list[Pose] = []

    @property
    def num_jumps(self) -> int:
        """Number of jumps."""
        return len(self._jump_times)

    def __len__(self) -> int:
        return len(self._times)

    def add(self, time: float, tf_odom_tracking: Pose) -> None:
        """Add a reading; of several at one time the last is kept, older ones are ignored."""
        if self._times and time <= self._times[-1]:
            if time == self._times[-1]:
                self._poses.pop()
                self._times.pop()
                self._append(time, tf_odom_tracking)
            return
        self._append(time, tf_odom_tracking)

    def _append(self, time: float, tf_odom_tracking: Pose) -> None:
        self._times.append(time)
        self._poses.append(self._in_track(time, tf_odom_tracking))

    def _in_track(self, time: float, tf_odom_tracking: Pose) -> Pose:
        """Return a new reading in the frame of the track, which is shifted if it jumps."""
        pose = tf_odom_tracking
        if self.num_jumps:
            pose = compose(self._tf_track_odom, pose)
        if self._poses and _is_jump(self._poses[-1], pose, time - self._times[-2]):
            self._jump_times.append(time)
            self._tf_track_odom = compose(self._poses[-1], inverse(tf_odom_tracking))
            return self._poses[-1]
        return pose

    def at(self, time: float) -> Pose | None:
        """Return tf_odom_tracking at a time, or None where the readings do not reach."""
        times, poses = self._times, self._poses
        if not times or time < times[0]:
            return None
        after = bisect_right(times, time)
        if after < len(times):
            fraction = (time - times[after - 1]) / (times[after] - times[after - 1])
            return interpolate(poses[after - 1], poses[after], fraction)
        beyond = time - times[-1]
        span = times[-1] - times[-2] if len(times) > 1 else MAX_PERIOD_S
        gives_speed = span < MAX_PERIOD_S
        if beyond > (MAX_EXTRAPOLATION_S if gives_speed else MAX_HOLD_SHARE * span):
            return None
        if beyond == 0.0 or not gives_speed:
            return poses[-1]
        return interpolate(poses[-2], poses[-1], 1.0 + beyond / span)

    def jumps_between(self, begin: float, end: float) -> bool:
        """Return whether the motion between two times is unknown because the readings jumped.

        It is unknown from the last reading before a jump to the first after it, and wherever it
        would be extrapolated from a jump.
        """
        times, jumps = self._times, self._jump_times
        if not jumps:
            return False
        first, last = min(begin, end), max(begin, end)
        if times[-1] == jumps[-1] and last > times[-1]:
            return True
        after = bisect_left(times, last)  # the reading up to which the motion is interpolated
        until = times[after] if after < len(times) else last
        return bisect_right(jumps, first) < bisect_right(jumps, until)

    def arrays(self) -> tuple[FloatArray, FloatArray]:
        """Return times, shape (n,), and poses, shape (n, 3)."""
        # Five times as fast as np.array of a list of tuples.
        poses = np.fromiter(chain.from_iterable(self._poses), np.float64, 3 * len(self._poses))
        return np.array(self._times), poses.reshape(-1, 3)


def _is_jump(before: Pose, after: Pose, duration: float) -> bool:
    """Return whether no robot can move from one pose to the other in a time [s]."""
    distance = math.hypot(after.x - before.x, after.y - before.y)
    turn = abs(wrap_angle(after.theta - before.theta))
    return (
        distance > MAX_STEP_M + MAX_SPEED * duration
        or turn > MAX_STEP_RAD + MAX_TURN_RATE * duration
    )
