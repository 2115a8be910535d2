# SPDX-License-Identifier: Apache-2.0
"""From messages, as they arrive, to sensor events in the order of time."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from cartoloop.live.inbox import Arrival
from cartoloop.live.messages import EndMessage
from cartoloop.live.notices import Notices
from cartoloop.live.scanner import FIRST_S, FIRST_SCANS, LiveScanner
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud, SensorEvent
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.stream_clock import ABSURD_S, SensorTimes, StreamClock

MAX_DELAY_S = 0.05
"""Longest wait of a scan for the other sensors' messages of its sweep [s]."""

ACTIVE_S = 1.0
"""Sensors that have been silent for longer than this are not waited for [s]."""

MAX_SENSORS = 16
"""Sensors of one robot; messages that name more of them are skipped."""

MAX_MISSES = 20
"""A sensor whose messages came too late for this number of scans in a row is not waited for."""


@dataclass(slots=True)
class _Stream:
    """State of the messages of one sensor.

    Attributes
    ----------
    latest : time of the newest [s].
    arrival : its time of arrival [s].
    misses : number of scans in a row for which its messages came too late.
    """

    latest: float = -math.inf
    arrival: float = -math.inf
    misses: int = 0
    times: SensorTimes = field(default_factory=SensorTimes)
    last_scan: LaserScan | None = None


@dataclass(order=True, slots=True)
class _Held:
    """A waiting scan; `end` is the time of its last beam, `deadline` by the inbox's clock."""

    time: float
    number: int
    event: LaserScan | PointCloud = field(compare=False)
    stream: _Stream = field(compare=False)
    end: float = field(compare=False)
    arrival: float = field(compare=False)
    deadline: float = field(compare=False)


class Sequencer:
    """Gives messages their times, scans the range limits of their scanner, and orders them.

    Odometry and IMU pass at once. A scan waits, for a bounded time, until the messages of all other
    sensors reach the end of its sweep. The first scans wait until their scanner's profile is known.

    Parameters
    ----------
    notices : receives the problems.
    max_delay : longest wait of a scan [s]; 0: none.
    laser_pose : mounting pose of the first scanner; overrides the one in its messages.
    """

    def __init__(
        self,
        notices: Notices,
        max_delay: float = MAX_DELAY_S,
        laser_pose: Pose | None = None,
    ) -> None:
        self._notices = notices
        self._max_delay = max_delay
        self._laser_pose = laser_pose
        self._clock = StreamClock()
        self._streams: dict[str, _Stream] = {}
        self._scanners: dict[str, LiveScanner] = {}
        self._first_arrival = math.nan
        self._held: list[_Held] = []
        self._passed: list[tuple[SensorEvent, float]] = []
        self._number = count()
        self._last_end = -math.inf, -math.inf
        self._profiled = False
        self._num_set = 0

    @property
    def next_deadline(self) -> float:
        """The earliest deadline of the waiting scans [s], inf if none waits."""
        if self._held and self._profiled:
            return min(held.deadline for held in self._held)
        return (
            math.inf
            if math.isnan(self._first_arrival) or self._profiled
            else (self._first_arrival + FIRST_S)
        )

    @property
    def scanners(self) -> dict[str, LiveScanner]:
        """The scanners by name."""
        return self._scanners

    def add(self, arrival: Arrival) -> None:
        """Add a message."""
        message = arrival.message
        if isinstance(message, EndMessage):
            return
        time = self._clock.time_of(message.stamp, arrival.time)
        if self._clock.num_set != self._num_set:
            self._num_set = self._clock.num_set
            self._notices.note(
                "clock set",
                f"the stamp {message.stamp:.6g} does not follow those before: a clock was set, or "
                "is another one; times continue as the messages arrive",
            )
        stamp = message.stamp if abs(message.stamp) < ABSURD_S else time
        match message:
            case Odometry():
                event = Odometry(stamp, time, message.tf_odom_tracking)
                self._pass("odometry", event, arrival.time)
            case Imu():
                imu = Imu(stamp, time, message.linear_acceleration, message.angular_velocity)
                self._pass("IMU", imu, arrival.time)
            case LaserScan():
                self._add_scan(message, stamp, time, arrival.time)
            case PointCloud():
                self._add_cloud(message, stamp, time, arrival.time)

    def ready(self, now: float) -> Iterator[tuple[SensorEvent, float]]:
        """Yield the events that do not have to wait any longer, each with its time of arrival.

        Parameters
        ----------
        now : by the clock of arrivals [s]; inf: nothing more will come.
        """
        passed, self._passed = self._passed, []
        yield from passed
        if not self._profiled:
            if now < self.next_deadline and not self._knows_enough():
                return
            self._read_profiles()
        while self._held:
            held = self._held[0]
            if now < held.deadline and self._awaited(held, now):
                return
            if now >= held.deadline and self._max_delay > 0.0:
                for stream in self._awaited(held, now):
                    stream.misses += 1
            heapq.heappop(self._held)
            self._last_end = held.end, held.deadline
            yield self._with_profile(held.event), held.arrival

    def _pass(self, name: str, event: Odometry | Imu, arrival: float) -> None:
        stream = self._stream(name)
        if event.time < stream.latest:
            self._notices.skip(f"{name} out of order, not used")
            return
        self._note_time(stream, event.time, arrival)
        self._passed.append((event, arrival))

    def _add_scan(self, message: LaserScan, stamp: float, time: float, arrival: float) -> None:
        name = message.geometry.sensor
        if (stream := self._scan_stream(name)) is None:
            return
        last, stream.last_scan = stream.last_scan, message
        if (
            last is not None
            and last.stamp == message.stamp
            and np.array_equal(last.ranges, message.ranges, equal_nan=True)
        ):
            self._notices.skip("the same scan again, not used")
            return
        scan = LaserScan(stamp, self._increasing(stream, time, arrival), message.ranges,
                         message.geometry)  # fmt: skip
        scanner = self._scanner(name)
        scanner.see(scan)
        if self._profiled and scanner.profile is None:
            scanner.read_profile()  # a later scanner cannot hold up the others
        self._hold(scan, stream, arrival)

    def _add_cloud(self, message: PointCloud, stamp: float, time: float, arrival: float) -> None:
        if (stream := self._scan_stream(message.geometry.sensor)) is None:
            return
        time = self._increasing(stream, time, arrival)
        geometry = message.geometry
        if self._laser_pose is not None:
            geometry = replace(geometry, tf_tracking_sensor=self._laser_pose)
        self._hold(
            PointCloud(stamp, time, message.points, message.times, geometry), stream, arrival
        )

    def _hold(self, scan: LaserScan | PointCloud, stream: _Stream, arrival: float) -> None:
        if math.isnan(self._first_arrival):
            self._first_arrival = arrival
        self._note_time(stream, scan.time, arrival)
        end = scan.time + scan.sweep[1]
        deadline = arrival + self._max_delay
        heapq.heappush(
            self._held,
            _Held(scan.time, next(self._number), scan, stream, end, arrival, deadline),
        )

    def _increasing(self, stream: _Stream, time: float, arrival: float) -> float:
        increasing = stream.times.increasing(time, arrival)
        if increasing != time:
            self._notices.note("stamps of scans repeat or run backwards: repaired")
        return increasing

    def _note_time(self, stream: _Stream, time: float, arrival: float) -> None:
        stream.latest, stream.arrival = time, arrival
        end, deadline = self._last_end
        if time >= end and arrival <= deadline:
            stream.misses = 0

    def _awaited(self, held: _Held, now: float) -> list[_Stream]:
        """Return the sensors whose messages of the scan's sweep may still come."""
        return [
            stream
            for stream in self._streams.values()
            if stream is not held.stream
            and stream.latest < held.end
            and now - stream.arrival < ACTIVE_S
            and stream.misses < MAX_MISSES
        ]

    def _knows_enough(self) -> bool:
        if not self._scanners:
            return bool(self._held)  # clouds need no profile
        return all(scanner.num_scans >= FIRST_SCANS for scanner in self._scanners.values())

    def _read_profiles(self) -> None:
        if not self._held:
            return
        self._profiled = True
        for scanner in self._scanners.values():
            scanner.read_profile()

    def _with_profile(self, event: LaserScan | PointCloud) -> LaserScan | PointCloud:
        if isinstance(event, PointCloud):
            return event
        scanner = self._scanners[event.geometry.sensor]
        return replace(event, geometry=scanner.geometry_of(event.geometry))

    def _stream(self, name: str) -> _Stream:
        stream = self._streams.get(name)
        if stream is None:
            stream = self._streams[name] = _Stream()
            self._notices.say(f"receiving {name}")
        return stream

    def _scan_stream(self, name: str) -> _Stream | None:
        key = f"scanner {name}".rstrip()
        if key not in self._streams and len(self._streams) >= MAX_SENSORS:
            self._notices.skip(f"scans of more than {MAX_SENSORS} sensors, not used")
            return None
        return self._stream(key)

    def _scanner(self, name: str) -> LiveScanner:
        scanner = self._scanners.get(name)
        if scanner is None:
            laser_pose = None if self._scanners else self._laser_pose
            scanner = self._scanners[name] = LiveScanner(name, self._notices.say, laser_pose)
        return scanner
