# SPDX-License-Identifier: Apache-2.0
"""Sensor events in, poses in a finished map out."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping
from os import PathLike
from typing import NamedTuple

import numpy as np

from cartoloop.arguments import as_numbers, as_path, require_type
from cartoloop.arrays import FloatArray
from cartoloop.config import Config
from cartoloop.errors import InputError, UsageError
from cartoloop.local_slam.local_slam import LocalSlam, LocalSlamResult, SensorCalibration
from cartoloop.localisation.answer import Answer, Place, State
from cartoloop.localisation.decision import (
    CLAIMED_AGREEMENT,
    CLAIMED_SCORE,
    MIN_POINTS,
    NOTHING,
    Claim,
    Decision,
    decide,
)
from cartoloop.localisation.doubt import Doubt
from cartoloop.localisation.global_search import find_near, is_same_place, refine
from cartoloop.localisation.known_map import KnownMap, known_map_of, load_known_map
from cartoloop.localisation.tracking import MAP_SIGMA_M, MAP_SIGMA_RAD, Tracker
from cartoloop.localisation.trail import LENGTH_M, SCAN_FILTER, Trail
from cartoloop.map_data import MapData
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.event_faults import EventChecker
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud, SensorEvent
from cartoloop.sensor.pose import IDENTITY, Pose, compose, inverse, relative
from cartoloop.sensor.range_filter import thin

SEARCH_STEP_M, SEARCH_TURN_RAD, SEARCH_PERIOD_S = 0.7, math.radians(30.0), 5.0
"""The map is searched again after this path, turn or time without a place [m], [rad], [s]."""

SHORT_PATH_M = 3.0
"""Path whose scans are searched where those of the whole trail fit nowhere [m]: the robot may have
come from where nothing is mapped."""

START_WINDOW_M, START_WINDOW_RAD = 1.0, math.radians(20.0)
"""Window around a given pose [m], [rad]."""

CHECK_STEP_M = 1.5
"""Path between two searches while a pose is doubted [m]."""

_EVENTS = "a LaserScan, PointCloud, Odometry or Imu"


class StartPose(NamedTuple):
    """A pose to begin with.

    Attributes
    ----------
    tf_map_tracking : of the robot.
    is_certain : whether a user gave it; otherwise scans must fit as well as for a claim.
    tf_odom_tracking : the odometry's pose then, if it has continued; None: not known.
    """

    tf_map_tracking: Pose
    is_certain: bool
    tf_odom_tracking: Pose | None = None

    def poses(self, tf_odom_tracking: Pose | None) -> list[Pose]:
        """Return the poses to try, given the odometry's pose now."""
        then = self.tf_odom_tracking
        if then is None or tf_odom_tracking is None:
            return [self.tf_map_tracking]
        moved = compose(self.tf_map_tracking, relative(then, tf_odom_tracking))
        return [moved, self.tf_map_tracking]


class _Scan(NamedTuple):
    """A scan as local SLAM sees it."""

    stamp: float
    time: float
    tf_local_tracking: Pose
    points: FloatArray
    beam_origin: Pose


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
    live : whether events come from a robot in real time: odometry may be late.
    calibration : what is known about the sensors before, as `Mapper.calibration`.

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
        calibration: SensorCalibration | None = None,
    ) -> None:
        if config is not None:
            require_type(config, Config, "Localizer: config", "a cartoloop.Config")
        self._config = config or Config()
        self._known = _as_known_map(map_)
        self._live = live
        self._calibration = calibration
        self._timer = StageTimer()
        self._checker = EventChecker(accepts_late_odometry=live)
        self._queue: deque[LaserScan | PointCloud] = deque()
        self._skipped: Counter[str] = Counter()
        self._first_sensor: str | None = None
        self._odom: Pose | None = None
        self._num_located = self._num_scans = 0
        self._answer: Answer | None = None
        self._start: StartPose | None = None
        if at is not None:
            self._start = StartPose(Pose(*as_numbers(at, "Localizer: at", 3)), True)
        self._was_located = False
        self._begin()

    def _begin(self) -> None:
        """Forget where the robot is, and all that the scans so far have shown."""
        self._local_slam = LocalSlam(
            self._config.local_slam,
            self._config.sensor,
            self._config.global_slam.constraint_search.adaptive_voxel_filter,
            self._timer,
            self._calibration,
        )
        self._trail = Trail()
        self._tracker: Tracker | None = None
        self._doubt = Doubt()
        self._last: _Scan | None = None
        self._decision = NOTHING
        self._tf_decided_local = IDENTITY
        self._searched_at: tuple[float, float, float] | None = None

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
        return self._local_slam.calibration

    def start_near(self, tf_map_tracking: Pose, tf_odom_tracking: Pose | None = None) -> None:
        """Try a pose at the next scan, and believe it only if the scan fits as well as for a claim.

        Parameters
        ----------
        tf_map_tracking : of the robot, some time ago.
        tf_odom_tracking : the odometry's pose then. Where it has continued, the robot's motion
            since then is known; it is also tried as if it had not moved.
        """
        self._start = StartPose(tf_map_tracking, False, tf_odom_tracking)

    def set_pose(self, tf_map_tracking: Pose | tuple[float, float, float]) -> None:
        """Begin again near a pose that a user gives, at the next scan."""
        self._calibration = self._local_slam.calibration
        self._begin()
        pose = Pose(*as_numbers(tf_map_tracking, "Localizer.set_pose: tf_map_tracking", 3))
        self._start = StartPose(pose, True)

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
            self._local_slam.add_odometry(event)
        elif isinstance(event, Imu):
            self._local_slam.add_imu(event)
        else:
            self._queue.append(event)
        return self._answer_queue(math.inf if self._live else event.time, on_answer)

    def finish(self, on_answer: Callable[[Answer], None] | None = None) -> Answer | None:
        """Answer the scans that still wait for odometry; return the last answer, or None."""
        return self._answer_queue(math.inf, on_answer)

    def _answer_queue(
        self, time: float, on_answer: Callable[[Answer], None] | None
    ) -> Answer | None:
        answer = None
        while self._queue and self._local_slam.ready_time(self._queue[0]) <= time:
            self._answer = answer = self._locate(self._queue.popleft())
            self._num_scans += 1
            self._num_located += answer.state is State.LOCATED
            if on_answer is not None:
                on_answer(answer)
        return answer

    def _locate(self, event: LaserScan | PointCloud) -> Answer:
        """Return the answer to a scan."""
        try:
            result = self._local_slam.add_scan(event)
        except InputError:
            # The path has become too long for a submap: only jumps of the odometry lead to that.
            self._lose()
            result = self._local_slam.add_scan(event)
        scan = self._scan_of(event, result)
        self._note(scan)
        agreement = math.nan
        if self._tracker is not None:
            agreement = self._track(self._tracker, scan)
            if self._doubt.is_lost:
                self._lose()
                scan = self._scan_of(event, self._local_slam.add_scan(event))
                self._note(scan)
        if self._tracker is None:
            self._search(scan)
        self._last = scan
        return self._answer_of(scan, agreement)

    def _note(self, scan: _Scan) -> None:
        self._trail.add(scan.tf_local_tracking, thin(scan.points, SCAN_FILTER), scan.beam_origin)

    def _scan_of(self, event: LaserScan | PointCloud, result: LocalSlamResult) -> _Scan:
        geometry = event.geometry
        if self._first_sensor is None:
            self._first_sensor = geometry.sensor
        mounting = geometry.tf_tracking_sensor
        given = self._config.sensor.laser_pose
        if given is not None and geometry.sensor == self._first_sensor:
            mounting = Pose(*given)
        points = thin(result.returns, self._config.local_slam.adaptive_voxel_filter)
        return _Scan(event.stamp, event.time, result.tf_local_tracking, points, mounting)

    def _track(self, tracker: Tracker, scan: _Scan) -> float:
        """Move and correct the pose; return the agreement."""
        step, duration = IDENTITY, 0.0
        if self._last is not None:
            step = relative(self._last.tf_local_tracking, scan.tf_local_tracking)
            duration = scan.time - self._last.time
        tracker.move(step)
        if len(scan.points) < MIN_POINTS:
            return math.nan
        agreement = tracker.correct(scan.points, scan.beam_origin)
        relative_agreement = agreement / self._known.usual.agreement
        self._doubt.add(relative_agreement, math.hypot(step.x, step.y), duration)
        if self._doubt.is_suspect and self._is_due(scan, CHECK_STEP_M):
            self._check(tracker, scan)
        return agreement

    def _check(self, tracker: Tracker, scan: _Scan) -> None:
        """Search for another place while the pose is doubted."""
        composite = self._trail.composite(SHORT_PATH_M)
        if composite is None:
            return
        self._note_search(scan)
        path = min(self._trail.length, SHORT_PATH_M)
        found = decide(self._known, composite, path)
        if found.claim is None:
            return
        if is_same_place(found.claim.tf_map_tracking, tracker.pose):
            self._doubt.reduce()
        else:
            self._decision = found
            self._follow(found.claim)

    def _lose(self) -> None:
        """Begin again, with the sensors' calibration: the pose is not believed any longer."""
        self._calibration = self._local_slam.calibration
        was_located = self._was_located or self._tracker is not None
        self._begin()
        self._was_located = was_located

    def _search(self, scan: _Scan) -> None:
        """Search for the robot, near a given pose or in the whole map, if it is time to."""
        if len(scan.points) < MIN_POINTS:
            return
        if self._start is not None:
            start, self._start = self._start, None
            if (claim := self._claim_near(start)) is not None:
                self._follow(claim)
                return
        if not self._is_due(scan, SEARCH_STEP_M):
            return
        self._note_search(scan)
        self._decision = self._decide()
        self._tf_decided_local = inverse(scan.tf_local_tracking)
        if self._decision.claim is not None:
            self._follow(self._decision.claim)

    def _decide(self) -> Decision:
        """Search the scans of the whole trail, and if they fit nowhere those of the last metres."""
        decision = NOTHING
        for length in (LENGTH_M, SHORT_PATH_M):
            composite = self._trail.composite(length)
            path = min(self._trail.length, length)
            if composite is not None:
                decision = decide(self._known, composite, path)
            if decision.places or decision.claim or self._trail.length <= SHORT_PATH_M:
                break
        return decision

    def _claim_near(self, start: StartPose) -> Claim | None:
        """Return the best place around given poses if the scan fits there."""
        composite = self._trail.composite(0.0)
        if composite is None:
            return None
        known, best = self._known, None
        for pose in start.poses(self._odom):
            found = find_near(
                known, composite.points, pose, START_WINDOW_M, START_WINDOW_RAD,
                CLAIMED_SCORE * known.usual.score,
            )  # fmt: skip
            if found is not None and (best is None or found.score > best.score):
                best = found
        if best is None:
            return None
        match = refine(known, composite.points, best.tf_map_tracking)
        pose = known.to_map(match.tf_submap_scan)
        x, y = composite.beam_origins[0].tolist()
        fit = known.fit(composite.points, Pose(x, y, 0.0), pose)
        least = 0.7 if start.is_certain else CLAIMED_AGREEMENT
        return Claim(pose, match) if fit.agreement >= least * known.usual.agreement else None

    def _is_due(self, scan: _Scan, step: float) -> bool:
        """Return whether the robot has moved, or waited, since the last search."""
        if self._searched_at is None:
            return True
        travelled, turned, time = self._searched_at
        return (
            self._trail.travelled - travelled >= step
            or self._trail.turned - turned >= SEARCH_TURN_RAD
            or scan.time - time >= SEARCH_PERIOD_S
        )

    def _note_search(self, scan: _Scan) -> None:
        self._searched_at = self._trail.travelled, self._trail.turned, scan.time

    def _follow(self, claim: Claim) -> None:
        """Track from a place that is claimed."""
        sigmas = np.array((2.0 * MAP_SIGMA_M, 2.0 * MAP_SIGMA_M, 3.0 * MAP_SIGMA_RAD))
        self._tracker = Tracker(
            self._known, self._config.local_slam, claim.tf_map_tracking, np.diag(sigmas**2)
        )
        self._doubt = Doubt()
        self._was_located = True

    def _answer_of(self, scan: _Scan, agreement: float) -> Answer:
        tracker, decision = self._tracker, self._decision
        if tracker is not None:
            fit = self._known.fit(scan.points, scan.beam_origin, tracker.pose)
            floor = np.diag((MAP_SIGMA_M**2, MAP_SIGMA_M**2, MAP_SIGMA_RAD**2))
            return Answer(
                scan.stamp, State.LOCATED, tracker.pose, tracker.covariance + 0.25 * floor,
                scan.tf_local_tracking, fit.score, decision.runner_up,
                fit.agreement if math.isnan(agreement) else agreement,
            )  # fmt: skip
        step = compose(self._tf_decided_local, scan.tf_local_tracking)
        places = tuple(
            Place(compose(pose, step), probability, score)
            for pose, probability, score in decision.places
        )
        state = State.AMBIGUOUS if places else State.SEARCHING
        if self._was_located and not places:
            state = State.LOST
        return Answer(
            scan.stamp, state, None, None, scan.tf_local_tracking, math.nan, decision.runner_up,
            math.nan, places,
        )  # fmt: skip


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
