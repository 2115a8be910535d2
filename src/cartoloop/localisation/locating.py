# SPDX-License-Identifier: Apache-2.0
"""Whether a robot is searched for or followed: the states of localisation, scan by scan."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import Config
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.localisation.answer import Answer, State
from cartoloop.localisation.decision import MIN_POINTS, Claim
from cartoloop.localisation.followed_place import fits_along
from cartoloop.localisation.following import Following
from cartoloop.localisation.global_search import is_same_place
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.local_motion import LocalMotion, LocalScan
from cartoloop.localisation.place_search import PlaceSearch
from cartoloop.localisation.search_runner import SearchRunner
from cartoloop.localisation.start_pose import StartPose, claim_near
from cartoloop.localisation.trail import LENGTH_M as TRAIL_M
from cartoloop.sensor.events import LaserScan, PointCloud
from cartoloop.sensor.pose import Pose


class Locating:
    """Answers scans: searches while the place is not known, and follows the robot from there.

    Parameters
    ----------
    known : the map.
    config : of sensors and local SLAM.
    calibration : what is known about the sensors before.
    in_background : whether searches run beside the scans that follow.

    Attributes
    ----------
    motion : of the robot, by local SLAM.
    start : pose to try at the next scan, None: there is none.
    given_fits : whether the scan fitted at the pose that a user gave; None while it was not tried.
    returns : of the last scan, float64, shape (n, 2), tracking frame [m].
    """

    def __init__(
        self,
        known: KnownMap,
        config: Config,
        calibration: SensorCalibration | None,
        *,
        in_background: bool,
    ) -> None:
        self._known, self._config = known, config
        self._runner = SearchRunner(in_background=in_background)
        self._was_located = False
        self._num_refuted = 0
        self._following: Following | None = None
        self._search = PlaceSearch(known, self._runner)
        self.motion = LocalMotion(config, calibration)
        self.start: StartPose | None = None
        self._given: StartPose | None = None
        self.given_fits: bool | None = None
        self.returns: FloatArray = np.zeros((0, 2))

    def give(self, start: StartPose) -> None:
        """Begin again at a pose that a user gives if the next scan fits there."""
        self._given, self.given_fits = start, None

    def call_when_searched(self, function: Callable[[], None]) -> None:
        """Call a function, in any thread, when the search has ended; at once if none is running."""
        self._runner.call_when_ended(function)

    def answer(self, event: LaserScan | PointCloud, tf_odom_tracking: Pose | None) -> Answer:
        """Return the answer to a scan.

        Parameters
        ----------
        tf_odom_tracking : the odometry's pose now, None without any.
        """
        scan = self._moved(event)
        if self.motion.has_lost_sight:
            self._lose_sight(scan, tf_odom_tracking)
            scan = self._moved(event)
        given = self._claim_at_given(scan, tf_odom_tracking)
        if given is not None:
            self._lose()
            self._num_refuted = 0
            scan = self._moved(event)
            self._believe(given, scan, is_given=True)
        elif self._following is not None:
            self._follow(self._following, scan)
            if self._following.doubt.is_lost:
                self._num_refuted += not self._following.doubt.is_proved
                self._lose()
                scan = self._moved(event)
        if self._following is None:
            self._find(scan, tf_odom_tracking)
        self.returns = scan.points
        return self._answer_of(scan)

    def _moved(self, event: LaserScan | PointCloud) -> LocalScan:
        scan = self.motion.add_scan(event)
        while scan is None:
            self._lose()
            scan = self.motion.add_scan(event)
        return scan

    def _lose_sight(self, scan: LocalScan, tf_odom_tracking: Pose | None) -> None:
        """Begin again, as the robot may be anywhere: first near where it was last, or is by now."""
        if self._following is not None:
            pose = self._following.predicted(scan)
            self.start = StartPose(pose, False, tf_odom_tracking, self._following.shown)
        self._lose()

    def _follow(self, following: Following, scan: LocalScan) -> None:
        """Track the robot, and search for another place while the pose is doubted."""
        following.add(scan)
        if following.doubt.lacks_proof and self._fits_along_trail(following.pose):
            following.doubt.restart_proof()
        if following.doubt.is_proved:
            self._num_refuted = 0
        suspect = following.doubt.is_suspect and len(scan.points) >= MIN_POINTS
        claim = self._search.check(scan, self.motion.trail, is_wanted=suspect)
        if claim is None:
            return
        if is_same_place(claim.tf_map_tracking, following.pose):
            following.doubt.reduce()
        else:
            self._believe(claim, scan)

    def _fits_along_trail(self, tf_map_tracking: Pose) -> bool:
        trail = self.motion.trail
        return fits_along(
            self._known, trail.composite(TRAIL_M), min(trail.length, TRAIL_M), tf_map_tracking
        )

    def _find(self, scan: LocalScan, tf_odom_tracking: Pose | None) -> None:
        """Search for the robot, near a given pose or in the whole map."""
        if len(scan.points) < MIN_POINTS:
            return
        start, self.start = self.start, None
        if start is not None:
            claim = self._claim_at(start, tf_odom_tracking)
            if start.is_certain:
                self.given_fits = claim is not None
            if claim is not None:
                self._believe(claim, scan, is_given=start.is_certain)
                return
        claim = self._search.search(scan, self.motion.trail, self._num_refuted)
        if claim is not None:
            self._believe(claim, scan)

    def _claim_at(self, start: StartPose, tf_odom_tracking: Pose | None) -> Claim | None:
        composite = self.motion.trail.composite(0.0)
        if composite is None:
            return None
        spurious = self._config.local_slam.prediction.spurious_information
        return claim_near(self._known, composite, start, tf_odom_tracking, spurious)

    def _claim_at_given(self, scan: LocalScan, tf_odom_tracking: Pose | None) -> Claim | None:
        """Return the claim at the pose that a user has given, None without, or if nothing fits."""
        if self._given is None or len(scan.points) < MIN_POINTS:
            return None
        claim = self._claim_at(self._given, tf_odom_tracking)
        self._given, self.given_fits = None, claim is not None
        return claim

    def _believe(self, claim: Claim, scan: LocalScan, *, is_given: bool = False) -> None:
        """Follow the robot from a place that is claimed."""
        self._following = Following(self._known, self._config.local_slam, claim, is_given=is_given)
        self._following.begin(scan)
        self._was_located = True

    def _lose(self) -> None:
        """Begin again, with the sensors' calibration: the pose is not believed any longer."""
        self._was_located = self._was_located or self._following is not None
        self._following = None
        self.motion.begin_again()
        self._search = PlaceSearch(self._known, self._runner)

    def _answer_of(self, scan: LocalScan) -> Answer:
        following, runner_up = self._following, self._search.decision.runner_up
        if following is not None:
            score, agreement = following.fit(scan)
            return Answer(
                scan.stamp, State.LOCATED, following.pose, following.covariance,
                scan.tf_local_tracking, score, runner_up, agreement,
            )  # fmt: skip
        places = self._search.places_now(scan)
        state = State.AMBIGUOUS if places else State.SEARCHING
        if self._was_located and not places:
            state = State.LOST
        return Answer(
            scan.stamp, state, None, None, scan.tf_local_tracking, math.nan, runner_up,
            math.nan, places,
        )  # fmt: skip
