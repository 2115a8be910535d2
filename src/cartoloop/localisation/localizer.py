# SPDX-License-Identifier: Apache-2.0
"""Sensor events in, poses in a finished map out."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping
from os import PathLike

from cartoloop.arguments import as_path, as_pose, require_type
from cartoloop.arrays import FloatArray
from cartoloop.config import Config
from cartoloop.errors import UsageError
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.localisation.answer import Answer, State
from cartoloop.localisation.changes.areas import Changes
from cartoloop.localisation.changes.watch import ChangeWatch
from cartoloop.localisation.known_map import KnownMap, known_map_of, load_known_map
from cartoloop.localisation.locating import Locating
from cartoloop.localisation.start_pose import StartPose
from cartoloop.map_data import MapData
from cartoloop.sensor.event_faults import EventChecker
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud, SensorEvent
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.stated_sweeps import StatedSweeps

_EVENTS = "a LaserScan, PointCloud, Odometry or Imu"


class Localizer:
    """Finds a robot in a finished map, and tracks it, scan by scan.

    >>> localizer = cartoloop.Localizer("office-map")
    >>> for event in cartoloop.read("drive.bag"):
    ...     if answer := localizer.add(event):
    ...         print(answer.stamp, answer.state, answer.tf_map_tracking)

    Parameters
    ----------
    map_ : what `cartoloop.load` or `Mapper.finish` returned; the path of a map; the path of the
        YAML file of a map of another program, as ROS's map_server reads it.
    config : parameters of sensors and local SLAM; by default the defaults.
    at : pose of the robot in the map at the first scan (x, y [m], theta [rad]), if it is known to
        about a metre and 20 degrees. Where the first scan does not fit there, it is ignored.
    live : whether events come from a robot in real time: odometry may be late, and the map is
        searched in a thread, so that :meth:`add` returns soon.
    waits : whether live events wait while the map is searched: answers are those of a recording.
    calibration : what is known about the sensors before, as `Mapper.calibration`.
    watch_changes : whether scans are compared with the map, for `changes`: 27 bytes a cell.

    Raises
    ------
    InputError
        The map cannot be read, or is empty.
    """

    def __init__(
        self,
        map_: MapData | KnownMap | str | PathLike[str],
        config: Config | None = None,
        *,
        at: Pose | tuple[float, float, float] | None = None,
        live: bool = False,
        waits: bool = False,
        calibration: SensorCalibration | None = None,
        watch_changes: bool = False,
    ) -> None:
        if config is not None:
            require_type(config, Config, "Localizer: config", "a cartoloop.Config")
        self._known = _as_known_map(map_)
        self._watch = ChangeWatch(self._known) if watch_changes else None
        self._live = live
        config = config or Config()
        self._locating = Locating(
            self._known, config, calibration, in_background=live and not waits
        )
        self._checker = EventChecker(accepts_late_odometry=live)
        self._sweeps = StatedSweeps(config.sensor.sweep_s)
        self._queue: deque[LaserScan | PointCloud] = deque()
        self._skipped: Counter[str] = Counter()
        self._odom: Pose | None = None
        self._num_located = self._num_scans = 0
        self._answer: Answer | None = None
        if at is not None:
            self._locating.start = StartPose(Pose(*as_pose(at, "Localizer: at")), True)

    @property
    def known_map(self) -> KnownMap:
        """The map."""
        return self._known

    @property
    def answer(self) -> Answer | None:
        """The answer to the last scan, None before the first."""
        return self._answer

    @property
    def num_scans(self) -> int:
        """Number of scans that were answered."""
        return self._num_scans

    @property
    def num_located(self) -> int:
        """Number of scans that were answered with a pose."""
        return self._num_located

    @property
    def skipped(self) -> Mapping[str, int]:
        """Number of skipped scans and events, by reason."""
        return self._skipped

    @property
    def odometry_pose(self) -> Pose | None:
        """The last odometry reading, None without any."""
        return self._odom

    @property
    def calibration(self) -> SensorCalibration:
        """What is known about the sensors by now."""
        return self._locating.motion.calibration

    def changes(self) -> Changes:
        """Return what differs between the map and what was seen by now.

        Raises
        ------
        UsageError
            `watch_changes` was not given.
        """
        if self._watch is None:
            raise UsageError("Localizer.changes: give watch_changes=True to Localizer")
        return self._watch.changes()

    def start_near(self, tf_map_tracking: Pose, tf_odom_tracking: Pose | None = None) -> None:
        """Try a pose at the next scan, and believe it only if the scan shows that it holds.

        Parameters
        ----------
        tf_map_tracking : of the robot, some time ago.
        tf_odom_tracking : the odometry's pose then. Where it has continued, the robot's motion
            since then is known; it is also tried as if it had not moved.
        """
        pose = Pose(*as_pose(tf_map_tracking, "Localizer.start_near: tf_map_tracking"))
        if tf_odom_tracking is not None:
            tf_odom_tracking = Pose(
                *as_pose(tf_odom_tracking, "Localizer.start_near: tf_odom_tracking")
            )
        self._locating.start = StartPose(pose, False, tf_odom_tracking)

    def set_pose(self, tf_map_tracking: Pose | tuple[float, float, float]) -> None:
        """Begin again near a pose that a user gives if the next scan fits there.

        Otherwise nothing changes; `given_pose_fits` says which.
        """
        pose = Pose(*as_pose(tf_map_tracking, "Localizer.set_pose: tf_map_tracking"))
        self._locating.give(StartPose(pose, True))

    @property
    def given_pose_fits(self) -> bool | None:
        """Whether a scan fitted at the pose of `at` or `set_pose`; None while it was not tried."""
        return self._locating.given_fits

    @property
    def returns(self) -> FloatArray:
        """Returns of the last scan, thinned, float64, shape (n, 2), tracking frame [m]."""
        return self._locating.returns

    def call_when_searched(self, function: Callable[[], None]) -> None:
        """Call a function, in any thread, when the search of the map in the background has ended.

        The next scan is answered with its result. Without such a search, it is called at once.
        """
        self._locating.call_when_searched(function)

    def add(
        self, event: SensorEvent, on_answer: Callable[[Answer], None] | None = None
    ) -> Answer | None:
        """Add one sensor event; return the answer to the last scan that it completed, or None.

        Bad data does not raise: it is skipped, and counted by reason. A scan that is measured beam
        by beam waits until odometry and IMU cover its sweep.

        Parameters
        ----------
        on_answer : called with each answer.

        Raises
        ------
        UsageError
            It is no event.
        """
        if not isinstance(event, LaserScan | PointCloud):
            require_type(event, Odometry | Imu, "Localizer.add: event", _EVENTS)
        if reason := self._checker.reason_to_skip(event):
            self._skipped[reason] += 1
            return None
        if isinstance(event, Odometry):
            self._odom = event.tf_odom_tracking
            self._locating.motion.add_odometry(event)
        elif isinstance(event, Imu):
            self._locating.motion.add_imu(event)
        else:
            self._queue.append(self._sweeps.of(event))
        return self._answer_queue(math.inf if self._live else event.time, on_answer)

    def finish(self, on_answer: Callable[[Answer], None] | None = None) -> Answer | None:
        """Answer the scans that still wait for odometry; return the last answer, or None."""
        return self._answer_queue(math.inf, on_answer)

    def _answer_queue(
        self, time: float, on_answer: Callable[[Answer], None] | None
    ) -> Answer | None:
        answer = None
        while self._queue and self._locating.motion.is_ready(self._queue[0], time):
            event = self._queue.popleft()
            self._answer = answer = self._locating.answer(event, self._odom)
            self._num_scans += 1
            self._num_located += answer.state is State.LOCATED
            scan = self._locating.motion.scan
            if self._watch is not None and scan is not None:
                self._watch.add(answer, scan.returns, scan.beam_origin)
            if on_answer is not None:
                on_answer(answer)
        return answer


def _as_known_map(map_: MapData | KnownMap | str | PathLike[str]) -> KnownMap:
    """Return what a caller gave as a map, prepared for localisation."""
    if isinstance(map_, KnownMap):
        return map_
    if isinstance(map_, MapData):
        return known_map_of(map_)
    if isinstance(map_, str | PathLike):
        return load_known_map(as_path(map_, "Localizer: map_"))
    raise UsageError(
        f"Localizer: map_ is a {type(map_).__name__}: give what cartoloop.load returned, or the "
        "path of a map"
    )
