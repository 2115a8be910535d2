# SPDX-License-Identifier: Apache-2.0
"""Sensor events in, a map out: local SLAM, then global SLAM. Start reading here."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cartoloop.config import Config
from cartoloop.global_slam.background import BackgroundGlobalSlam
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.global_slam.growing_array import GrowingArray
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.trajectory import optimized_trajectory, path_length
from cartoloop.local_slam.local_slam import LocalSlam, LocalSlamResult
from cartoloop.local_slam.pose_extrapolator import MAX_SWEEP_S
from cartoloop.map_output.report import (
    AdjustmentSummary,
    InputSummary,
    Report,
    summarize_constraints,
)
from cartoloop.map_output.result import Result
from cartoloop.sensor.event_faults import fault_of
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud, SensorEvent
from cartoloop.sensor.pose import IDENTITY, FloatArray, Pose, compose
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

    Parameters
    ----------
    config : all parameters; the defaults if None.
    live : whether the scans come from a robot that does not wait. No pose waits for the graph then:
        it is kept in a thread of its own, searches join it when they are done, and are dropped when
        too many are behind. Odometry may be late. What comes out depends on the moment.
    """

    def __init__(self, config: Config | None = None, *, live: bool = False) -> None:
        self._config = config or Config()
        self._timer = StageTimer()
        self._local_slam = LocalSlam(self._config, self._timer)
        self._global_slam = GlobalSlam(
            self._config.global_slam, self._timer, wait_for_searches=not live
        )
        self._back_end = BackgroundGlobalSlam(self._global_slam) if live else None
        self._stamps = GrowingArray((), np.float64)
        self._local_poses = GrowingArray((3,), np.float64)
        self._local_pose = IDENTITY
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
        return compose(self._global_slam.tf_map_local, self._local_pose)

    @property
    def local_pose(self) -> Pose:
        """Where the robot was at the last scan, in the local frame: it drifts, but never jumps."""
        return self._local_pose

    @property
    def global_slam(self) -> GlobalSlam:
        """The pose graph and the searches; to be looked at, in the thread that `look` calls."""
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
        return self._last_time - self._first_time if len(self._stamps) else 0.0

    @property
    def last_stamp(self) -> float:
        """Stamp of the last scan that was mapped [s], NaN before the first."""
        return float(self._stamps.view[-1]) if len(self._stamps) else math.nan

    def node_stamps(self, first: int) -> FloatArray:
        """Return the stamps [s] of the graph's nodes from `first` on, shape (n,)."""
        scans = self._node_scan_index[first : self._global_slam.graph.num_nodes]
        stamps: FloatArray = self._stamps.view[np.array(scans, dtype=np.int64)]
        return stamps

    def add(self, event: SensorEvent, on_pose: Callable[[], None] | None = None) -> None:
        """Take in one sensor event. Bad data does not raise: it is skipped, and counted by reason.

        A scan that is measured beam by beam waits until what follows tells how the robot moved
        meanwhile.

        Parameters
        ----------
        event : what a sensor told.
        on_pose : called for each scan as soon as `pose` is that of it, before it is inserted into
            the submaps; must be quick.

        Raises
        ------
        InputError
            The pose has gone astray, further than any map could reach. What was mapped before
            stands; `result` returns it.
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
        # Live, whoever adds scans knows better what may yet come.
        self._add_scans_that_ended(math.inf if self._back_end is not None else event.time, on_pose)

    def finish(self, note: Callable[[str], None] | None = None) -> Result:
        """Close the last loops, adjust all and return the map; nothing can be added after.

        Parameters
        ----------
        note : called with what comes next, in words, now and then, in this thread.
        """
        try:
            self._add_scans_that_ended(math.inf)
            if (failure := self._end_back_end()) is not None:
                raise failure
            self._global_slam.finish(self._local_slam.active_submaps, note)
        finally:
            self.close()
        return self.result()

    def close(self) -> None:
        """End the background threads and drop their searches; only `result` may follow."""
        self._end_back_end()
        self._global_slam.close()

    def look(self, task: Callable[[], None]) -> None:
        """Have something done while the pose graph stands still, with all nodes so far in it.

        At once, or in live mapping soon, in the thread of the graph. Local SLAM does not stand
        still there.
        """
        if self._back_end is None:
            task()
        else:
            self._back_end.call(task)

    def result_later(self, receive: Callable[[Result], None]) -> None:
        """Have the map as it stands handed over, without waiting; see `look`.

        It is the receiver's own: whatever is mapped later does not change it.
        """
        num_scans, active = len(self._local_poses), self._local_slam.active_submaps

        def hand_over() -> None:
            result = self._result(num_scans, active)
            graph = result.graph
            receive(replace(result, graph=graph.copy(), closures=result.closures.copy()))

        self.look(hand_over)

    def result(self) -> Result:
        """Return the map as it stands, without waiting for searches.

        In live mapping, only after `close`; see `result_later`.
        """
        return self._result(len(self._local_poses), self._local_slam.active_submaps)

    def _result(self, num_scans: int, active: Sequence[Submap]) -> Result:
        """Return the map of so many scans that got a pose, with these submaps still growing."""
        graph = self._global_slam.graph
        node_scan_index = np.array(self._node_scan_index[: graph.num_nodes], dtype=np.int64)
        local = self._local_poses.view[:num_scans].copy()
        trajectory = optimized_trajectory(local, node_scan_index, graph.node_poses)
        return Result(
            self._stamps.view[:num_scans].copy(),
            trajectory,
            local,
            graph,
            node_scan_index,
            self._submap_grids(graph, active),
            self._config,
            self._report(graph, trajectory),
            closures=self._global_slam.closures,
            node_points=self._global_slam.node_points,
        )

    def _objection(self, event: SensorEvent) -> str | None:
        """Return why an event cannot be used, or None."""
        if fault := fault_of(event):
            return fault
        if isinstance(event, Imu):
            return None
        if isinstance(event, Odometry):
            # Live, it may come a little after the scan; the track knows what to do.
            is_late = event.time < self._last_time and self._back_end is None
            return "time runs backwards" if is_late else None
        if event.time < self._last_time:
            return "time runs backwards"
        repeats = self._last_time_of.get(event.geometry.sensor) == event.time
        return "two scans at one time" if repeats else None

    def _add_scans_that_ended(self, time: float, on_pose: Callable[[], None] | None = None) -> None:
        """Hand on the scans of which nothing more is to be known at a time."""
        waiting = self._waiting
        while waiting:
            scan = waiting[0]
            end = scan.time + min(scan.sweep[1], MAX_SWEEP_S)
            if end > time and self._local_slam.extrapolator.follows_motion:
                return
            self._add_scan(waiting.popleft(), on_pose)

    def _add_scan(self, scan: LaserScan | PointCloud, on_pose: Callable[[], None] | None) -> None:
        if not len(self._stamps):
            self._first_time = scan.time

        def hand_out(tf_local_tracking: Pose) -> None:
            self._local_pose = tf_local_tracking
            if on_pose is not None:
                on_pose()

        result = self._local_slam.add_scan(scan, hand_out)
        if not result.was_matched and result.node is None:
            self._skipped["too few returns to match: pose as predicted"] += 1
        self._last_scan = result
        self._stamps.append(scan.stamp)
        self._local_poses.append(result.tf_local_tracking)
        if result.node is not None:
            self._node_scan_index.append(len(self._stamps) - 1)
            (self._back_end or self._global_slam).add_node(result.node)

    def _end_back_end(self) -> Exception | None:
        """Have all nodes added, and the graph from now on to ourselves; return what failed."""
        if self._back_end is None:
            return None
        back_end, self._back_end = self._back_end, None
        back_end.close()
        return back_end.failure

    def _submap_grids(self, graph: PoseGraph, active: Sequence[Submap]) -> list[FinishedGrid]:
        grids = self._global_slam.finished_grids()
        for submap in active:
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
            constraints=summarize_constraints(graph, self._global_slam.closures),
            adjustment=AdjustmentSummary.of_runs(self._global_slam.adjustments),
            stages=self._timer.summary(),
            skipped=dict(sorted(self._skipped.items())),
            extra=self._what_sensors_told() | self._what_was_dropped(),
        )

    def _what_was_dropped(self) -> dict[str, Any]:
        """Return how many searches were dropped, for the report, where any were."""
        num_dropped = self._global_slam.closures.num_dropped
        return {"searches_dropped": num_dropped} if num_dropped else {}

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
