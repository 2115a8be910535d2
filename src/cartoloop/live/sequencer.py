# SPDX-License-Identifier: Apache-2.0
"""From messages, as they arrive, to sensor events in the order that mapping wants them."""

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
"""A scan waits no longer than this for what else was measured until it ended [s]."""

ACTIVE_S = 1.0
"""Sensors that have said nothing for so long are not waited for [s]."""

MAX_SENSORS = 16
"""Messages that name still another sensor are nonsense."""

MAX_MISSES = 20
"""Nor are those for which so many scans in a row have waited in vain, until they come in time."""


@dataclass(slots=True)
class _Stream:
    """What is known of the messages of one sensor.

    Attributes
    ----------
    latest : time of the newest [s].
    arrival : when that came [s].
    misses : how many scans in a row waited for it in vain.
    """

    latest: float = -math.inf
    arrival: float = -math.inf
    misses: int = 0
    times: SensorTimes = field(default_factory=SensorTimes)
    last_scan: LaserScan | None = None


@dataclass(order=True, slots=True)
class _Held:
    """A scan that waits; `end` is the time of its last beam, `deadline` by the inbox's clock."""

    time: float
    number: int
    event: LaserScan | PointCloud = field(compare=False)
    stream: _Stream = field(compare=False)
    end: float = field(compare=False)
    arrival: float = field(compare=False)
    deadline: float = field(compare=False)


class Sequencer:
    """Gives messages their time, scans the limits of their scanner, and all of them an order.

    Odometry and IMU pass at once. A scan waits, for a bounded time, until all other sensors have
    told of the time until it ended. The first scans wait until it is known what sent them.

    Parameters
    ----------
    notices : is told what is wrong.
    max_delay : how long a scan waits [s]; 0: not at all.
    laser_pose : where the first scanner sits on the robot, whatever it says.
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
        """When the next scan has waited for long enough [s], inf if none waits."""
        if self._held and self._profiled:
            return min(held.deadline for held in self._held)
        return (
            math.inf
            if math.isnan(self._first_arrival) or self._profiled
            else (self._first_arrival + FIRST_S)
        )

    @property
    def scanners(self) -> dict[str, LiveScanner]:
        """The scanners by their name."""
        return self._scanners

    def add(self, arrival: Arrival) -> None:
        """Take in a message."""
        message = arrival.message
        if isinstance(message, EndMessage):
            return
        time = self._clock.time_of(message.stamp, arrival.time)
        if self._clock.num_set != self._num_set:
            self._num_set = self._clock.num_set
            self._notices.note(
                "clock set",
                f"the stamp {message.stamp:.6g} does not follow those before: a clock was set, or "
                "is another one; times go on as the messages arrive",
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
        """Yield the events that need not wait any longer, each with when it arrived.

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
            scanner.read_profile()  # one that came later cannot hold up the others
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
        """Return the sensors that may yet tell of the time until a scan ended."""
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
