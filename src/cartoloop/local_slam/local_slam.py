# SPDX-License-Identifier: Apache-2.0
"""Local SLAM (section IV): match each scan to the older active submap, insert it into both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from cartoloop.arrays import FloatArray
from cartoloop.config import (
    AdaptiveVoxelFilterConfig,
    LocalSlamConfig,
    SensorConfig,
)
from cartoloop.journal.outcomes import NO_RUN_OUTCOMES, RunOutcomes
from cartoloop.local_slam.degenerate_direction import degenerate_direction
from cartoloop.local_slam.measured_distance import NEAR_QUANTILE
from cartoloop.local_slam.odometry_window import Evidence
from cartoloop.local_slam.pose_extrapolator import PoseExtrapolator
from cartoloop.local_slam.prediction import Prediction, isotropic_information
from cartoloop.local_slam.recorded_steps import RecordedSteps
from cartoloop.local_slam.scan_filter import FilteredScan, ScanFilter
from cartoloop.local_slam.scan_matcher import MatchedScan, ScanMatcher, follows_odometry
from cartoloop.local_slam.scanner import Scanner
from cartoloop.local_slam.scanner_clocks import ScannerClocks
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.local_slam.submap_building import SubmapBuilder
from cartoloop.local_slam.sweep_prediction import MAX_SWEEP_S
from cartoloop.local_slam.unmatched_stretch import UnmatchedStretch
from cartoloop.local_slam.wall_step import FAR_QUANTILE
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.range_filter import RangeData
from cartoloop.submaps.node import Node, shows_place
from cartoloop.submaps.submap import Submap


@dataclass(frozen=True, slots=True)
class LocalSlamResult:
    """The pose of a scan, and the node that it became.

    Attributes
    ----------
    tf_local_tracking : its pose before loop closure.
    was_matched : False where there were too few returns, so that the pose is the prediction.
    node : None unless the scan was inserted into the submaps.
    returns : float64, shape (n, 2), its returns [m], tracking frame.
    match : the match to the older active submap, None where it was not matched.
    """

    tf_local_tracking: Pose
    was_matched: bool
    node: Node | None
    returns: FloatArray
    match: LeastSquaresMatch | None = None


class LocalSlam:
    """Turns scans into poses in the local frame, and into submaps.

    Parameters
    ----------
    config : parameters of local SLAM.
    sensor : which part of a scan is used.
    node_filter : voxel filter of the points that a node keeps for loop closure; None: no loops are
        closed, and nodes keep no points.
    timer : measures the stages.
    known : what is known about the sensors before; by default nothing.
    first_node, first_submap : indices of the first ones: those of earlier sessions come before.
    outcomes : of the run; matches are replayed from there, or recorded there.
    """

    def __init__(
        self,
        config: LocalSlamConfig,
        sensor: SensorConfig,
        node_filter: AdaptiveVoxelFilterConfig | None,
        timer: StageTimer,
        known: SensorCalibration | None = None,
        outcomes: RunOutcomes = NO_RUN_OUTCOMES,
        *,
        first_node: int = 0,
        first_submap: int = 0,
    ) -> None:
        self._config = config
        self._recorded = RecordedSteps(outcomes.local)
        self._timer = timer
        self._filter = ScanFilter(sensor, config.adaptive_voxel_filter)
        self._scanners: dict[str, Scanner] = {}
        self._submaps = SubmapBuilder(config, node_filter, outcomes, first_node, first_submap)
        self._clocks = ScannerClocks(known.scanner_offsets if known else None)
        self._unmatched = UnmatchedStretch()
        self.extrapolator = PoseExtrapolator(config, known)

    @property
    def active_submaps(self) -> tuple[Submap, ...]:
        """The growing submaps, and those about to be finished, the oldest first."""
        return self._submaps.unfinished

    @property
    def calibration(self) -> SensorCalibration:
        """What is known about the sensors by now."""
        odometry = self.extrapolator.odometry
        return SensorCalibration(
            odometry.model,
            self._clocks.offsets,
            odometry.score,
            odometry.held_s,
            odometry.is_mirrored,
        )

    def summary(self) -> dict[str, Any]:
        """Return the estimates about odometry, IMU and scanners, for the report."""
        summary = self.extrapolator.summary()
        if len(self._scanners) > 1:
            scanners = sorted(self._scanners.items())
            summary["scanners"] = {name: scanner.num_scans for name, scanner in scanners}
            summary["scanner_time_offsets_s"] = dict(sorted(self._clocks.offsets.items()))
        if useful_ranges := self._filter.useful_ranges:
            summary["useful_range_m"] = useful_ranges
        return summary

    def add_odometry(self, odometry: Odometry) -> None:
        """Add a wheel-odometry reading."""
        self.extrapolator.add_odometry(odometry.time, odometry.tf_odom_tracking)
        if self.extrapolator.odometry.is_long:
            begins = [scanner.distance_meter.begin for scanner in self._scanners.values()]
            self.extrapolator.odometry.forget([time for time in begins if time is not None])

    def add_imu(self, imu: Imu) -> None:
        """Add an inertial reading."""
        self.extrapolator.add_imu(imu)

    def is_ready(self, scan: LaserScan | PointCloud, time: float) -> bool:
        """Return whether the odometry and IMU readings that affect a scan have been read by a time.

        Odometry is waited for until it reaches the end of the sweep by its own clock, but for no
        longer than its next reading may take.
        """
        if not self.extrapolator.measures_motion:
            return True
        offset = self._clocks.offset_of(scan.geometry.sensor)
        end = scan.time + offset + min(scan.sweep[1], MAX_SWEEP_S)
        odometry = self.extrapolator.odometry
        return end <= time and (odometry.reaches(end) or time > end + odometry.longest_wait_s)

    def add_scan(
        self, scan: LaserScan | PointCloud, on_pose: Callable[[Pose], None] | None = None
    ) -> LocalSlamResult:
        """Match a scan and insert it if the robot moved enough since the last insertion.

        Parameters
        ----------
        on_pose : called with the scan's pose in the local frame as soon as it is known, before the
            scan is inserted.

        Raises
        ------
        InputError
            The scan is so far from the previous ones that no submap can hold both.
        """
        scanner, name = self._scanner_of(scan), scan.geometry.sensor
        time = scan.time + self._clocks.offset_of(name)
        self._make_up()
        filtered = self._deskewed(scan, time)
        scanner.noise = filtered.data.noise
        with self._timer.measure("predict"):
            prediction = self.extrapolator.predict(time)
        has_points = len(filtered.points) >= self._config.insertion.min_num_points
        match, by_walls = None, False
        # The first scan of a further scanner may show a place that is not mapped yet.
        if has_points and scanner.is_in_map:
            match = self._match(filtered, prediction, scanner.matcher)
            filtered, match = self._deskew_again(scan, time, filtered, match, scanner.matcher)
            match, by_walls = self._along_walls(time, filtered, match, scanner, prediction)
        pose = match.tf_local_tracking if match else prediction.tf_local_tracking
        if on_pose is not None:
            on_pose(pose)
        with self._timer.measure("predict"):
            shown = match
            if match and follows_odometry(match.match, prediction, filtered.points):
                shown = None
            evidence = self._evidence(shown, scanner, filtered.points, by_walls=by_walls)
            if match is not None and match.is_relocated:
                self.extrapolator.relocate()
                scanner.distance_meter.forget()
            slips = by_walls and prediction.by_odometry
            missed = scanner.wall_step.missed_velocity if slips else None
            self.extrapolator.add_pose(time, pose, filtered.motion, evidence, name, missed)
            if match is not None and (by := self._clocks.add(name, time, pose)):
                self.extrapolator.shift(name, by)
        scanner.wall_step.add(time, pose, filtered.data.tf_tracking_sensor, filtered.data.returns)
        self._measure_distance(time, pose, filtered.data, scanner)
        self._unmatched.add(pose)
        if match is not None and prediction.gap and scanner.matcher.is_misfit(match.match):
            self._unmatched.add_gap(prediction.gap)
            scanner.motion_filter.forget()
        node = None
        if has_points and scanner.motion_filter.is_new(scan.time, pose):
            information = self._submaps.information(shown)
            if shown is not None and shows_place(information):
                self._unmatched.clear()
            node = self._insert(scan, filtered.data, pose, information)
            scanner.is_in_map = True
        self._recorded.add_scan(scan.stamp, pose)
        fit = match.match if match else None
        return LocalSlamResult(pose, match is not None, node, filtered.data.returns, fit)

    def _scanner_of(self, scan: LaserScan | PointCloud) -> Scanner:
        """Return the state of a scan's scanner, and count the scan."""
        name = scan.geometry.sensor
        scanner = self._scanners.get(name)
        if scanner is None:
            scanner = self._scanners[name] = Scanner.of(self._config)
        scanner.count(scan)
        return scanner

    def _make_up(self) -> None:
        """Correct the latest poses where odometry that has stopped alone has held them."""
        missed = self.extrapolator.make_up()
        if missed is not None:
            for scanner in self._scanners.values():
                scanner.wall_step.correct(missed)

    def _deskewed(self, scan: LaserScan | PointCloud, time: float) -> FilteredScan:
        """Return a scan deskewed by the motion that the extrapolator expects."""
        with self._timer.measure("filter"):
            return self._filter.apply(scan, self.extrapolator.sweep_motion(time, *scan.sweep))

    def _match(
        self, filtered: FilteredScan, prediction: Prediction, matcher: ScanMatcher
    ) -> MatchedScan:
        """Return the match of a scan to the submap that is to be matched, which exists."""
        submap = self._submaps.to_match(by_odometry=prediction.by_odometry)

        def compute() -> MatchedScan:
            with self._timer.measure("match"):
                return matcher.match(submap, filtered.points, prediction)

        return self._recorded.match(matcher, submap, compute)

    def _deskew_again(
        self,
        scan: LaserScan | PointCloud,
        time: float,
        filtered: FilteredScan,
        match: MatchedScan,
        matcher: ScanMatcher,
    ) -> tuple[FilteredScan, MatchedScan]:
        """Return a scan and its match, both repeated where the match reveals another motion."""
        pose = match.tf_local_tracking
        motion = self.extrapolator.corrected_motion(time, pose, filtered.motion)
        if motion is None:
            return filtered, match
        with self._timer.measure("filter"):
            filtered = self._filter.apply(scan, motion)
        if len(filtered.points) < self._config.insertion.min_num_points:
            return filtered, match
        prediction = self.extrapolator.prediction_from(time, pose)
        return filtered, self._match(filtered, prediction, matcher)

    def _evidence(
        self, match: MatchedScan | None, scanner: Scanner, points: FloatArray, *, by_walls: bool
    ) -> Evidence | None:
        """Return what a match of a scanner says about the motion, None without a match."""
        if match is None:
            return None
        if by_walls:
            return scanner.evidence_by_walls()
        turned = self._submaps.older.tf_local_submap.theta
        spurious = self._config.prediction.spurious_information
        return scanner.evidence(match.match, turned, points, spurious)

    def _along_walls(
        self,
        time: float,
        filtered: FilteredScan,
        match: MatchedScan,
        scanner: Scanner,
        prediction: Prediction,
    ) -> tuple[MatchedScan, bool]:
        """Return a match, repeated where the scan before shows another step along bare walls.

        Also returns whether it was repeated.
        """
        if match.is_relocated:
            return match, False
        pose = self._step_along_walls(scanner, time, match, filtered.data.returns, prediction)
        if pose is None:
            return match, False
        if prediction.by_odometry:
            missed = scanner.wall_step.missed_velocity
            pose = self.extrapolator.since_slip(time, match.tf_local_tracking, pose, missed)
        information = isotropic_information(
            self._config.wall_step.position_sigma, self._config.prediction.lost_rotation_sigma
        )
        # what the scans say of the step is as good as odometry
        prediction = Prediction(pose, True, information, lambda: (pose, pose))
        return self._match(filtered, prediction, scanner.matcher), True

    def _measure_distance(self, time: float, pose: Pose, data: RangeData, scanner: Scanner) -> None:
        """Measure the distance from a scan about a metre back, to calibrate the odometry.

        Also while that is not trusted: its distances may be wrong by a factor.
        """
        meter = scanner.distance_meter
        if not self.extrapolator.odometry.shows_motion:
            meter.forget()
            return
        with self._timer.measure("match"):
            distance = meter.add(
                time,
                pose,
                data.tf_tracking_sensor,
                data.returns,
                partial(scanner.noise_of, data.returns, NEAR_QUANTILE),
            )
        if distance is not None:
            self.extrapolator.odometry.add_distance(distance)

    def _step_along_walls(
        self,
        scanner: Scanner,
        time: float,
        match: MatchedScan,
        returns: FloatArray,
        prediction: Prediction,
    ) -> Pose | None:
        """Return a better pose along bare walls; see `WallStep.better_pose`."""
        wall_step = scanner.wall_step

        def compute() -> Pose | None:
            with self._timer.measure("match"):
                return wall_step.better_pose(
                    time,
                    match.tf_local_tracking,
                    returns,
                    by_odometry=prediction.by_odometry,
                    stands=prediction.stands,
                    match_ratio=degenerate_direction(match.match)[0],
                    noise=partial(scanner.noise_of, returns, FAR_QUANTILE),
                )

        return self._recorded.wall_step(wall_step, compute)

    def _insert(
        self,
        scan: LaserScan | PointCloud,
        data: RangeData,
        tf_local_tracking: Pose,
        information: FloatArray,
    ) -> Node:
        """Insert a scan into the active submaps and return its node."""
        by_odometry = self._unmatched.end(self.extrapolator.odometry.model, information)
        with self._timer.measure("insert"):
            node = self._submaps.insert(
                scan,
                data,
                tf_local_tracking,
                information if by_odometry is None else by_odometry,
                starts_over=by_odometry is not None,
            )
        self._recorded.add_node(node, data.tf_tracking_sensor)
        if node.finished is not None:
            self._recorded.add_calibration(self.calibration)
        return node
