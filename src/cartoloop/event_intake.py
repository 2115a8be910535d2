# SPDX-License-Identifier: Apache-2.0
"""Checks the events of a session, and queues scans until other sensors cover their sweeps."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator

from cartoloop.arguments import require_type
from cartoloop.config import SensorConfig
from cartoloop.local_slam.local_slam import LocalSlam
from cartoloop.sensor.event_faults import EventChecker
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud, SensorEvent
from cartoloop.sensor.stated_sweeps import StatedSweeps

_EVENTS = "a LaserScan, PointCloud, Odometry or Imu"


class EventIntake:
    """Passes odometry and IMU readings on to local SLAM, and holds scans until they are ready.

    Parameters
    ----------
    config : which part of a scan is used, and how long a sweep is.
    local_slam : knows when the readings that affect a scan have been read.
    accepts_late_odometry : whether odometry may be older than what came before it.

    Attributes
    ----------
    num_scans : number of scans taken, skipped ones included.
    skipped : number of skipped scans and events, by reason.
    """

    def __init__(
        self, config: SensorConfig, local_slam: LocalSlam, *, accepts_late_odometry: bool
    ) -> None:
        self._local_slam = local_slam
        self._checker = EventChecker(accepts_late_odometry=accepts_late_odometry)
        self._sweeps = StatedSweeps(config.sweep_s)
        self._queue: deque[LaserScan | PointCloud] = deque()
        self.num_scans = 0
        self.skipped: Counter[str] = Counter()

    @property
    def duration_s(self) -> float:
        """Time from the first scan that was taken to the last [s]; there must be one."""
        return self._checker.last_time - self._checker.first_time

    def take(self, event: SensorEvent) -> bool:
        """Take an event; return False if it is skipped, and count why.

        Raises
        ------
        UsageError
            It is no event.
        """
        if isinstance(event, LaserScan | PointCloud):
            self.num_scans += 1
        else:
            require_type(event, Odometry | Imu, "Mapper.add: event", _EVENTS)
        if reason := self._checker.reason_to_skip(event):
            self.skipped[reason] += 1
            return False
        if isinstance(event, Odometry):
            self._local_slam.add_odometry(event)
        elif isinstance(event, Imu):
            self._local_slam.add_imu(event)
        else:
            self._queue.append(self._sweeps.of(event))
        return True

    def ready_scans(self, time: float) -> Iterator[LaserScan | PointCloud]:
        """Remove and return the scans, in order, whose sweeps are covered by a time [s]."""
        while self._queue and self._local_slam.is_ready(self._queue[0], time):
            yield self._queue.popleft()
