# SPDX-License-Identifier: Apache-2.0
"""Wheel odometry as a continuous motion: poses between and shortly beyond the readings."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.local_slam.odometry_pace import MAX_PERIOD_S, Pace
from cartoloop.local_slam.odometry_readings import OdometryReadings
from cartoloop.local_slam.reading_period import MAX_REPEAT_S, ReadingPeriod
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

MIN_SPAN_S, MIN_SPAN_PERIODS = 0.05, 0.75
"""Shortest time over which the speed of this motion is measured [s], [usual periods], the longer of
both: messages that waited together have stamps a millisecond apart."""

MAX_HOLD_SHARE = 0.05
"""Readings further apart than `MAX_PERIOD_S` do not determine a speed. The robot is then assumed at
the last reading, for a time that is this share of the time between them."""

MAX_HEAD_SHARE = 0.15
"""A step that begins before the first reading, by this share of it, is known nearly whole: sparse
scans of a recording begin before the odometry if its clock is late."""

MAX_SHARE_AT_JUMP = 0.5
"""The same of a step that begins right before a jump: after it the robot moves as before."""

MAX_STEP_M, MAX_SPEED = 1.0, 10.0
"""A step longer than MAX_STEP_M + MAX_SPEED * duration [m], [m/s] is a reset of the odometry, since
no robot on wheels is so fast."""

MAX_STEP_RAD, MAX_TURN_RATE = 1.0, 10.0
"""The same for the heading [rad], [rad/s]."""

MANY_JUMPS, JUMPING_SHARE = 5, 0.1
"""Odometry with as many jumps, which are this share of its readings at least, shows no motion."""

SPEED_OVER_S = 0.3
"""Time before a reading over which its speed is measured [s]."""

MIN_SPEED, MAX_DECELERATION = 0.3, 2.0
"""A robot faster than both does not stand at once [m/s], [m/s^2]: a reading equal to the last one
repeats it."""


class OdometryTrack:
    """The odometry readings so far, by their time, but for those that were forgotten.

    A jump further than a robot can move is a reset: the track continues from its last pose, as if
    the robot had not moved. The motion across a jump is not known: see `jumps_between`.

    A reading that is repeated while the robot moves, because the odometry is slower than its
    stamps, is left out: the motion is uniform until the odometry catches up. That it was repeated
    shows in the speed before, or only afterwards. So is one that is sent again until the next is
    read, by odometry that does so all the time.

    Parameters
    ----------
    held_s : how long readings are held, by an earlier pass; 0 if they are not, or unknown [s].

    Attributes
    ----------
    num_jumps : number of jumps.
    num_late : how often it caught up.
    late_since : time of the reading that it last repeated before it caught up [s].
    latest : time of the latest reading [s], be it left out.
    has_moved : whether it has reported any motion.
    period : how often it is read.
    revision : grows with each change of the readings.
    """

    def __init__(self, held_s: float = 0.0) -> None:
        self.num_jumps = self.num_late = 0
        self.latest = -math.inf
        self.late_since = math.nan
        self.has_moved = False
        self.period = ReadingPeriod(held_s)
        self._is_repeating = False
        self._pace = self._pace_before = Pace()  # now, and before the last reading
        self._jump_times: list[float] = []
        self._frames: list[Pose] = []  # tf_track_odom from each jump on
        self._readings = OdometryReadings()
        self._last = IDENTITY
        self._num_forgotten = 0
        self.revision = 0

    def __len__(self) -> int:
        """Return the number of readings, with those that were forgotten."""
        return len(self._readings) + self._num_forgotten

    @property
    def jumps_often(self) -> bool:
        """Whether most that it reports is by chance: robots are slower than its steps."""
        return self.num_jumps >= MANY_JUMPS and self.num_jumps >= JUMPING_SHARE * len(self)

    @property
    def known_until(self) -> float:
        """Up to when it is known how the robot moved [s].

        A reading that is sent again does not show it. The next one shows whether the first after a
        gap is of its end.
        """
        if self._is_after_gap():
            return self._readings.times[-2]
        if self.period.are_held and self._is_repeating:
            return self._readings.times[-1]
        return self.latest

    @property
    def is_long(self) -> bool:
        """Whether it is time to forget some of the readings."""
        return self._readings.are_many

    def forget(self, needed: FloatArray, reach: float) -> None:
        """Forget the readings that are far from some times, but for the latest.

        Poses, jumps and motion around these times remain the same, to the last bit.

        Parameters
        ----------
        needed : the times [s], shape (n,).
        reach : that are kept before and after each [s].
        """
        before = len(self._readings)
        self._readings.forget(needed, reach)
        self._num_forgotten += before - len(self._readings)
        # Between two readings that are left, one jump says as much as many.
        after = np.searchsorted(np.array(self._readings.times), self._jump_times)
        is_last = np.append(after[1:] != after[:-1], True)[: len(after)]
        self._jump_times = np.array(self._jump_times)[is_last].tolist()
        self._frames = [self._frames[row] for row in np.flatnonzero(is_last).tolist()]

    def add(self, time: float, tf_odom_tracking: Pose) -> None:
        """Add a reading; of several at one time the last is kept, older ones are ignored."""
        times = self._readings.times
        self.latest = max(self.latest, time)
        if times and time <= times[-1]:
            if time == times[-1]:
                self._replace_last(time, tf_odom_tracking)
            return
        self._append(time, tf_odom_tracking)

    def _replace_last(self, time: float, tf_odom_tracking: Pose) -> None:
        self._pop()
        self._pace = self._pace_before
        self._append(time, tf_odom_tracking)

    def _pop(self) -> None:
        self.revision += 1
        self._readings.pop()
        self._last = self._readings.pose(-1) if len(self._readings) else IDENTITY

    def _append(self, time: float, tf_odom_tracking: Pose) -> None:
        self.period.add(time, tf_odom_tracking)
        pose = self._in_track(time, tf_odom_tracking)
        was_repeating, self._is_repeating = self._is_repeating, self._repeats(time, pose)
        if self._is_repeating:
            return
        if len(self._readings):
            self._drop_outdated(time, pose)
            if self._drop_repeated(time, pose) or (was_repeating and pose != self._last):
                self.num_late += 1
                self.late_since = self._readings.times[-1]
            self._pace_before = self._pace
            self._pace = self._pace.with_step(time, self._last, pose)
            self.has_moved = self.has_moved or pose != self._last
        self.revision += 1
        self._readings.append(time, pose)
        self._last = pose

    def _drop_repeated(self, time: float, pose: Pose) -> bool:
        """Drop readings that were repeated, if the next one shows it; return whether it does."""
        readings, times = self._readings, self._readings.times
        if len(times) < 2 or pose == self._last or self._last != readings.pose(-2):
            return False
        longest = self.period.held_s
        # The first motion may be a reset.
        if self.has_moved and self._pace.has_caught_up(self._last, pose, time - times[-1]):
            longest = MAX_REPEAT_S
        number = len(times)
        while len(times) > 1 and self._last == readings.pose(-2) and time - times[-2] <= longest:
            self._pop()
        return len(times) < number

    def _drop_outdated(self, time: float, pose: Pose) -> None:
        """Drop the first reading after a gap if the next one shows that it was older."""
        if not self._is_after_gap():
            return
        times, is_hasty = self._readings.times, self._pace.is_hasty
        before = self._readings.pose(-2)
        if is_hasty(self._last, pose, time - times[-1]) and not is_hasty(
            before, pose, time - times[-2]
        ):
            self._pop()

    def _is_after_gap(self) -> bool:
        """Return whether the last reading is the first after a gap."""
        times = self._readings.times
        longest = max(MAX_PERIOD_S, self.period.longest_s)
        return len(times) > 1 and times[-1] - times[-2] > longest

    def _in_track(self, time: float, tf_odom_tracking: Pose) -> Pose:
        """Return a new reading in the frame of the track, which is shifted if it jumps."""
        pose = tf_odom_tracking
        if self._frames:
            pose = compose(self._frames[-1], pose)
        if len(self._readings) and self._is_jump(self._last, pose, time):
            self.num_jumps += 1
            self._jump_times.append(time)
            self._frames.append(compose(self._last, inverse(tf_odom_tracking)))
            return self._last
        return pose

    def _is_jump(self, before: Pose, after: Pose, time: float) -> bool:
        """Return whether the robot cannot have moved from one pose to the other until a time."""
        distance = math.hypot(after.x - before.x, after.y - before.y)
        turn = abs(wrap_angle(after.theta - before.theta))
        since, usual = time - self._readings.times[-1], self.period.usual_s
        is_exceeded = self._pace.is_exceeded(distance, turn, time, usual)
        return is_exceeded or _is_too_far(distance, turn, since)

    def _repeats(self, time: float, pose: Pose) -> bool:
        """Return whether a reading repeats the last one though the robot moves."""
        times = self._readings.times
        # At a jump, the track repeats its last pose.
        if len(times) < 2 or pose != self._last or time in self._jump_times[-1:]:
            return False
        since = time - times[-1]
        if self.period.are_held:
            return time - self.period.latest_new <= self.period.longest_s
        if self._is_repeating:
            return since <= MAX_REPEAT_S
        before = min(bisect_left(times, times[-1] - SPEED_OVER_S), len(times) - 2)
        # The last step is slower if the robot brakes, and longer than the others by chance.
        speed = min(self._speed_since(before), self._speed_since(-2))
        return speed > max(MIN_SPEED, MAX_DECELERATION * since)

    def _speed_since(self, row: int) -> float:
        """Return the speed from a reading to the last one [m/s]."""
        first, last, times = self._readings.pose(row), self._last, self._readings.times
        moved = math.hypot(last.x - first.x, last.y - first.y)
        return moved / (times[-1] - times[row])

    def at(self, time: float) -> Pose | None:
        """Return tf_odom_tracking at a time, or None where the readings do not reach."""
        times, pose = self._readings.times, self._readings.pose
        if not times or time < times[0]:
            return None
        after = bisect_right(times, time)
        if after < len(times):
            fraction = (time - times[after - 1]) / (times[after] - times[after - 1])
            return interpolate(pose(after - 1), pose(after), fraction)
        beyond = time - times[-1]
        shortest = max(MIN_SPAN_S, MIN_SPAN_PERIODS * self.period.usual_s)
        before = bisect_right(times, times[-1] - shortest) - 1
        span = times[-1] - times[before] if before >= 0 else MAX_PERIOD_S
        gives_speed = span < MAX_PERIOD_S
        if beyond > (MAX_EXTRAPOLATION_S if gives_speed else MAX_HOLD_SHARE * span):
            return None
        if beyond == 0.0 or not gives_speed:
            return self._last
        return interpolate(pose(before), self._last, 1.0 + beyond / span)

    def known_from(self, begin: float, end: float) -> float:
        """Return from when on a step is known: its begin, or a reading that is a little later.

        That is the first one, or the first one after a jump.
        """
        times = self._readings.times
        if not times or begin >= times[-1]:
            return begin
        after = bisect_left(times, begin)
        share = MAX_HEAD_SHARE if after == 0 else MAX_SHARE_AT_JUMP if self._jumped(after) else 0.0
        is_little = 0.0 < times[after] - begin <= share * (end - begin)
        return times[after] if is_little else begin

    def _jumped(self, row: int) -> bool:
        """Return whether a reading is the first after a jump."""
        time = self._readings.times[row]
        number = bisect_left(self._jump_times, time)
        return number < len(self._jump_times) and self._jump_times[number] == time

    def jumps_between(self, begin: float, end: float) -> bool:
        """Return whether the motion between two times is unknown because the readings jumped.

        It is unknown from the last reading before a jump to the first after it, and wherever it
        would be extrapolated from a jump.
        """
        times, jumps = self._readings.times, self._jump_times
        if not jumps:
            return False
        first, last = min(begin, end), max(begin, end)
        if times[-1] == jumps[-1] and last > times[-1]:
            return True
        after = bisect_left(times, last)  # the reading up to which the motion is interpolated
        until = times[after] if after < len(times) else last
        return bisect_right(jumps, first) < bisect_right(jumps, until)

    def longest_pause(self, begin: float, end: float) -> float:
        """Return the longest time between neighbouring readings that ends between two times [s]."""
        times = self._readings.times
        first = max(bisect_right(times, begin), 1)
        last = min(bisect_left(times, end), len(times) - 1)
        return max((times[row] - times[row - 1] for row in range(first, last + 1)), default=0.0)

    def reported_at(self, time: float) -> Pose | None:
        """Return tf_odom_tracking as it was reported, jumps included; None as :meth:`at`.

        Right before a jump it is the pose after it: what seems to be one may be a motion in a gap
        that the times do not show, and most of such a gap precedes a scan.
        """
        pose, times = self.at(time), self._readings.times
        after = bisect_left(times, time)
        if after < len(times) and self._jumped(after):
            pose, time = self._readings.pose(after), times[after]
        return None if pose is None else self._as_reported(time, pose)

    def reported_around(self, time: float, reach: float) -> list[Pose]:
        """Return the readings next to a time as they were reported, jumps included.

        That is the last one before it and the first two from it on.

        Parameters
        ----------
        reach : readings further away are left out [s].
        """
        times = self._readings.times
        after = bisect_left(times, time)
        return [
            self._as_reported(times[row], self._readings.pose(row))
            for row in range(max(after - 1, 0), min(after + 2, len(times)))
            if abs(times[row] - time) <= reach
        ]

    def _as_reported(self, time: float, pose: Pose) -> Pose:
        """Return a pose of the track in the frame in which it was reported at a time."""
        number = bisect_right(self._jump_times, time)
        return pose if number == 0 else compose(inverse(self._frames[number - 1]), pose)

    def arrays(self) -> tuple[FloatArray, FloatArray]:
        """Return times and poses, whose headings are continuous, shapes (n,), (n, 3)."""
        return self._readings.rows()


def _is_too_far(distance: float, turn: float, duration: float) -> bool:
    """Return whether no robot can move so far [m] and turn so much [rad] in a time [s]."""
    return (
        distance > MAX_STEP_M + MAX_SPEED * duration
        or turn > MAX_STEP_RAD + MAX_TURN_RATE * duration
    )
