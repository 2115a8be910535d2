# SPDX-License-Identifier: Apache-2.0
"""Sensor events in, a map out: local SLAM, then global SLAM. Start reading here."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from cartoloop.config import Config
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.trajectory import optimized_trajectory, path_length
from cartoloop.local_slam.local_slam import LocalSlam, LocalSlamResult
from cartoloop.map_output.report import (
    AdjustmentSummary,
    InputSummary,
    Report,
    summarize_constraints,
)
from cartoloop.map_output.result import Result
from cartoloop.sensor.event_faults import fault_of
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud, SensorEvent
from cartoloop.sensor.pose import FloatArray, Pose, compose
from cartoloop.stage_timer import StageTimer
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.submap import Submap

__all__ = ["Mapper", "Result"]


class Mapper:
    """Builds a map out of sensor events, one by one, in the order they happened.

    >>> mapper = Mapper()
    >>> for event in cartoloop.read("intel.clf.gz"):
    ...     mapper.add(event)
    >>> mapper.finish().save("out")
    """

    def __init__(self, config: Config | None = None) -> None:
        self._config = config or Config()
        self._timer = StageTimer()
        self._local_slam = LocalSlam(self._config, self._timer)
        self._global_slam = GlobalSlam(self._config.global_slam, self._timer)
        self._stamps: list[float] = []
        self._local_poses: list[Pose] = []
        self._node_scan_index: list[int] = []
        self._skipped: Counter[str] = Counter()
        self._last_scan: LocalSlamResult | None = None
        self._num_scans = 0
        self._waiting: deque[LaserScan | PointCloud] = deque()
        self._first_time = math.nan
        self._last_time = -math.inf
        self._last_time_of: dict[str, float] = {}

    @property
    def num_scans(self) -> int:
        """How many scans have been added."""
        return self._num_scans

    @property
    def num_nodes(self) -> int:
        """How many of them became nodes of the pose graph."""
        return len(self._node_scan_index)

    @property
    def num_loop_closures(self) -> int:
        """How many loop closures the pose graph holds."""
        return self._global_slam.num_loop_closures

    @property
    def pose(self) -> Pose:
        """Where the robot was at the last scan, in the map as adjusted so far."""
        local = self._local_poses[-1] if self._local_poses else Pose(0.0, 0.0, 0.0)
        return compose(self._global_slam.tf_map_local, local)

    @property
    def global_slam(self) -> GlobalSlam:
        """The pose graph and the searches; to be looked at, in the mapping thread."""
        return self._global_slam

    @property
    def active_submaps(self) -> tuple[Submap, ...]:
        """The submaps that still grow, the older first; to be looked at."""
        return self._local_slam.active_submaps

    @property
    def last_scan(self) -> LocalSlamResult | None:
        """What became of the last scan that was mapped, None before the first."""
        return self._last_scan

    @property
    def skipped(self) -> Mapping[str, int]:
        """How many scans and events were skipped, by reason."""
        return self._skipped

    @property
    def recorded_s(self) -> float:
        """Time from the first scan to the last [s], 0 before the first."""
        return self._last_time - self._first_time if self._stamps else 0.0

    @property
    def last_stamp(self) -> float:
        """Stamp of the last scan that was mapped [s], NaN before the first."""
        return self._stamps[-1] if self._stamps else math.nan

    def node_stamps(self, first: int) -> FloatArray:
        """Return the stamps [s] of the nodes from `first` on, shape (n,)."""
        return np.array([self._stamps[scan] for scan in self._node_scan_index[first:]])

    def add(self, event: SensorEvent) -> None:
        """Take in one sensor event. Bad data never raises: it is skipped, and counted by reason.

        A scan that is measured beam by beam waits until what follows tells how the robot moved
        meanwhile.
        """
        if isinstance(event, LaserScan | PointCloud):
            self._num_scans += 1
        if reason := self._objection(event):
            self._skipped[reason] += 1
            return
        if isinstance(event, Odometry):
            self._local_slam.add_odometry(event)
        elif isinstance(event, Imu):
            self._local_slam.add_imu(event)
        else:
            self._last_time = self._last_time_of[event.geometry.sensor] = event.time
            self._waiting.append(event)
        self._add_scans_that_ended(event.time)

    def finish(self) -> Result:
        """Close the last loops, adjust all and return the map; nothing can be added after."""
        try:
            self._add_scans_that_ended(math.inf)
            self._global_slam.finish(self._local_slam.active_submaps)
        finally:
            self.close()
        return self.result()

    def close(self) -> None:
        """End the background threads and drop their searches; only `result` may follow."""
        self._global_slam.close()

    def result(self) -> Result:
        """Return the map as it stands, without waiting for searches."""
        graph = self._global_slam.graph
        node_scan_index = np.array(self._node_scan_index[: graph.num_nodes], dtype=np.int64)
        local = np.array(self._local_poses, dtype=np.float64).reshape(-1, 3)
        trajectory = optimized_trajectory(local, node_scan_index, graph.node_poses)
        return Result(
            np.array(self._stamps, dtype=np.float64),
            trajectory,
            local,
            graph,
            node_scan_index,
            self._submap_grids(graph),
            self._config,
            self._report(graph, trajectory),
            found=tuple(self._global_slam.found),
            rejected=tuple(self._global_slam.rejected),
            node_points=tuple(self._global_slam.node_points),
        )

    def _objection(self, event: SensorEvent) -> str | None:
        """Return why an event cannot be used, or None."""
        if fault := fault_of(event):
            return fault
        if isinstance(event, Imu):
            return None
        if event.time < self._last_time:
            return "time runs backwards"
        if isinstance(event, Odometry):
            return None
        repeats = self._last_time_of.get(event.geometry.sensor) == event.time
        return "two scans at one time" if repeats else None

    def _add_scans_that_ended(self, time: float) -> None:
        """Hand on the scans of which nothing more is to be known at a time."""
        waiting = self._waiting
        while waiting:
            scan = waiting[0]
            if scan.time + scan.sweep[1] > time and self._local_slam.extrapolator.follows_motion:
                return
            self._add_scan(waiting.popleft())

    def _add_scan(self, scan: LaserScan | PointCloud) -> None:
        if not self._stamps:
            self._first_time = scan.time
        result = self._local_slam.add_scan(scan)
        if not result.was_matched and result.node is None:
            self._skipped["too few returns to match: pose as predicted"] += 1
        self._last_scan = result
        self._stamps.append(scan.stamp)
        self._local_poses.append(result.tf_local_tracking)
        if result.node is not None:
            self._node_scan_index.append(len(self._stamps) - 1)
            self._global_slam.add_node(result.node)

    def _submap_grids(self, graph: PoseGraph) -> list[FinishedGrid]:
        grids = self._global_slam.finished_grids()
        for submap in self._local_slam.active_submaps:
            if submap.index not in grids:
                grids[submap.index] = submap.grid.finish()
        return [grids[index] for index in range(graph.num_submaps)]

    def _report(self, graph: PoseGraph, trajectory: FloatArray) -> Report:
        return Report(
            input=InputSummary(
                scans=self._num_scans,
                duration_s=self.recorded_s,
                path_length_m=path_length(trajectory),
            ),
            nodes=graph.num_nodes,
            submaps=graph.num_submaps,
            constraints=summarize_constraints(
                graph,
                self._global_slam.search.num_searched,
                self._global_slam.found,
                len(self._global_slam.rejected),
            ),
            adjustment=AdjustmentSummary.of_runs(self._global_slam.adjustments),
            stages=self._timer.summary(),
            skipped=dict(sorted(self._skipped.items())),
            extra=self._what_sensors_told(),
        )

    def _what_sensors_told(self) -> dict[str, Any]:
        """Return what has turned out about odometry, IMU and scanners, for the report."""
        extrapolator = self._local_slam.extrapolator
        model, imu = extrapolator.odometry_model, extrapolator.imu
        told: dict[str, Any] = {
            "odometry": {
                "time_offset_s": model.time_offset,
                "rotation_scale": model.rotation_scale,
                "translation_scale": model.translation_scale,
                "yaw_rad": model.yaw,
                "lever_m": [model.lever_x, model.lever_y],
                "rotation_error_rad": model.rotation_error if model.is_known else None,
                "translation_error_m": model.translation_error if model.is_known else None,
                "jumps": extrapolator.num_odometry_jumps,
            },
        }
        if imu is not None:
            calibration = extrapolator.imu_calibration
            told["imu"] = {
                "readings": imu.num_readings,
                "tells_gravity": imu.tells_gravity,
                "max_tilt_rad": imu.max_tilt,
                "gyro_bias_rad_s": list(imu.gyro_bias),
                "rests": imu.num_rests,
                "tells_heading": calibration.agrees,
                "time_offset_s": calibration.time_offset if calibration.is_measured else None,
            }
        scanners = self._local_slam.num_scans_of
        if len(scanners) > 1:
            told["scanners"] = scanners
        if extrapolator.num_overlong_sweeps:
            told["sweeps_too_long"] = extrapolator.num_overlong_sweeps
        return told
