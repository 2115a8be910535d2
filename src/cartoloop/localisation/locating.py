# SPDX-License-Identifier: Apache-2.0
"""Whether a robot is searched for or followed: the states of localisation, scan by scan."""

from __future__ import annotations

import math

from cartoloop.config import Config
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.localisation.answer import Answer, State
from cartoloop.localisation.decision import MIN_POINTS, Claim
from cartoloop.localisation.following import Following
from cartoloop.localisation.global_search import is_same_place
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.local_motion import LocalMotion, LocalScan
from cartoloop.localisation.place_search import PlaceSearch
from cartoloop.localisation.search_runner import SearchRunner
from cartoloop.localisation.start_pose import StartPose, claim_near
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
        self._following: Following | None = None
        self._search = PlaceSearch(known, self._runner)
        self.motion = LocalMotion(config, calibration)
        self.start: StartPose | None = None

    def begin_again(self, start: StartPose) -> None:
        """Forget where the robot is, and all that the scans so far have shown."""
        self._lose()
        self._was_located = False
        self.start = start

    def answer(self, event: LaserScan | PointCloud, tf_odom_tracking: Pose | None) -> Answer:
        """Return the answer to a scan.

        Parameters
        ----------
        tf_odom_tracking : the odometry's pose now, None without any.
        """
        scan = self._moved(event)
        if self._following is not None:
            self._follow(self._following, scan)
            if self._following.doubt.is_lost:
                self._lose()
                scan = self._moved(event)
        if self._following is None:
            self._find(scan, tf_odom_tracking)
        return self._answer_of(scan)

    def _moved(self, event: LaserScan | PointCloud) -> LocalScan:
        scan = self.motion.add_scan(event)
        while scan is None:
            self._lose()
            scan = self.motion.add_scan(event)
        return scan

    def _follow(self, following: Following, scan: LocalScan) -> None:
        """Track the robot, and search for another place while the pose is doubted."""
        following.add(scan)
        suspect = following.doubt.is_suspect and len(scan.points) >= MIN_POINTS
        claim = self._search.check(scan, self.motion.trail, is_wanted=suspect)
        if claim is None:
            return
        if is_same_place(claim.tf_map_tracking, following.pose):
            following.doubt.reduce()
        else:
            self._believe(claim, scan)

    def _find(self, scan: LocalScan, tf_odom_tracking: Pose | None) -> None:
        """Search for the robot, near a given pose or in the whole map."""
        if len(scan.points) < MIN_POINTS:
            return
        claim = self._claim_at_start(tf_odom_tracking)
        if claim is None:
            claim = self._search.search(scan, self.motion.trail)
        if claim is not None:
            self._believe(claim, scan)

    def _claim_at_start(self, tf_odom_tracking: Pose | None) -> Claim | None:
        start, self.start = self.start, None
        composite = self.motion.trail.composite(0.0)
        if start is None or composite is None:
            return None
        return claim_near(self._known, composite, start, tf_odom_tracking)

    def _believe(self, claim: Claim, scan: LocalScan) -> None:
        """Follow the robot from a place that is claimed."""
        self._following = Following(self._known, self._config.local_slam, claim.tf_map_tracking)
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
            fit = following.fit(scan)
            return Answer(
                scan.stamp, State.LOCATED, following.pose, following.covariance,
                scan.tf_local_tracking, fit.score, runner_up, fit.agreement,
            )  # fmt: skip
        places = self._search.places_now(scan)
        state = State.AMBIGUOUS if places else State.SEARCHING
        if self._was_located and not places:
            state = State.LOST
        return Answer(
            scan.stamp, state, None, None, scan.tf_local_tracking, math.nan, runner_up,
            math.nan, places,
        )  # fmt: skip
