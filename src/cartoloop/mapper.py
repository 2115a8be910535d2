# SPDX-License-Identifier: Apache-2.0
"""Sensor events in, a map out: local SLAM, then global SLAM. Start reading here."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike

from cartoloop.arguments import require_type
from cartoloop.arrays import FloatArray
from cartoloop.config import Config
from cartoloop.earlier_sessions import whole_trajectory, with_parts
from cartoloop.errors import UsageError
from cartoloop.event_intake import EventIntake
from cartoloop.global_slam.background import BackgroundGlobalSlam
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.trajectory import path_length
from cartoloop.journal.outcomes import NO_RUN_OUTCOMES, RunOutcomes
from cartoloop.local_slam.local_slam import LocalSlam, LocalSlamResult
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.map_data import MapData
from cartoloop.map_finishing import finished_map
from cartoloop.map_sessions import checked_onto_pose, earlier_maps
from cartoloop.mapped_scans import MappedScans
from cartoloop.part_check import part_check
from cartoloop.report import (
    AdjustmentSummary,
    InputSummary,
    Report,
    RunClock,
    summarize_constraints,
)
from cartoloop.result import Result
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.events import LaserScan, PointCloud, SensorEvent
from cartoloop.sensor.pose import IDENTITY, Pose, compose
from cartoloop.session import Session
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.submap import Submap


class Mapper:
    """Builds a map from sensor events, one by one, in the order of their times.

    >>> mapper = Mapper()
    >>> for event in cartoloop.read("intel.clf.gz"):
    ...     mapper.add(event)
    >>> mapper.finish().save("out")

    Parameters
    ----------
    config : all parameters; the defaults if None.
    live : whether the events come from a robot in real time. The pose graph then has a thread of
        its own, so that no pose waits for it; searches join the graph when they are done, and are
        dropped when too many are pending. Odometry may be late. The result depends on timing.
    calibration : what is known about the sensors before, as `calibration` of another mapper; by
        default nothing. It is estimated again while mapping.
    onto : a map, or the path of one: a session is added to it. It finds its place by searching all
        submaps while mapping, at the latest in `finish`; until then it is a part of its own. The
        map that is given does not change.
    onto_pose : where the robot is in that map at the first scan, to a metre or two and 20 degrees;
        then its scans are searched for there only.
    outcomes : of a run with a journal; those of earlier steps are replayed, new ones are recorded.

    Raises
    ------
    InputError
        The map cannot be read.
    UsageError
        Mapping cannot go on from it, or only with another configuration.
    """

    def __init__(
        self,
        config: Config | None = None,
        *,
        live: bool = False,
        calibration: SensorCalibration | None = None,
        onto: MapData | str | PathLike[str] | None = None,
        onto_pose: Pose | None = None,
        outcomes: RunOutcomes = NO_RUN_OUTCOMES,
    ) -> None:
        if config is not None:
            require_type(config, Config, "Mapper: config", "a cartoloop.Config")
        start = checked_onto_pose(onto, onto_pose, "Mapper")
        self._earlier = earlier = earlier_maps(onto, config)
        config = config or (earlier.maps[0].config if earlier.maps else Config())
        self._config = config
        self._timer = StageTimer()
        self._local_slam = LocalSlam(
            config.local_slam,
            config.sensor,
            config.global_slam.constraint_search.adaptive_voxel_filter,
            self._timer,
            calibration,
            outcomes,
            first_node=len(earlier.node_scan_index),
            first_submap=earlier.num_submaps,
        )
        self._global_slam = GlobalSlam(
            config.global_slam,
            self._timer,
            outcomes.graph,
            wait_for_searches=not live,
            mapped=earlier.mapped,
            check_geometry=part_check(config),
        )
        if earlier.maps:
            self._global_slam.begin_session(start)
        self._back_end = BackgroundGlobalSlam(self._global_slam) if live else None
        self._scans = MappedScans(earlier)
        self._local_pose = IDENTITY
        self._last_scan: LocalSlamResult | None = None
        self._intake = EventIntake(config.sensor, self._local_slam, accepts_late_odometry=live)
        self._clock: RunClock | None = None
        self._is_closed = False
        self._finished: Result | None = None

    @property
    def num_scans(self) -> int:
        """Number of scans added."""
        return self._intake.num_scans

    @property
    def num_nodes(self) -> int:
        """Number of scans that became nodes of the pose graph."""
        return self._scans.num_nodes

    @property
    def calibration(self) -> SensorCalibration:
        """What is known about the sensors: clock offsets, scales and errors of the odometry."""
        return self._local_slam.calibration

    @property
    def num_loop_closures(self) -> int:
        """Number of loop closures in the pose graph."""
        return self._global_slam.num_loop_closures

    @property
    def pose(self) -> Pose:
        """Pose of the robot at the last mapped scan, map frame as adjusted so far."""
        return compose(self._global_slam.tf_map_local, self._local_pose)

    @property
    def local_pose(self) -> Pose:
        """Pose of the robot at the last mapped scan, local frame: it drifts, but never jumps."""
        return self._local_pose

    @property
    def global_slam(self) -> GlobalSlam:
        """Pose graph and searches. Read only; live, only in a task of `run_on_graph_thread`."""
        return self._global_slam

    @property
    def active_submaps(self) -> tuple[Submap, ...]:
        """The growing submaps, the older first. Read only."""
        return self._local_slam.active_submaps

    @property
    def last_scan(self) -> LocalSlamResult | None:
        """Result of the last mapped scan, None before the first."""
        return self._last_scan

    @property
    def skipped(self) -> Mapping[str, int]:
        """Number of skipped scans and events, by reason."""
        return self._intake.skipped

    @property
    def recorded_s(self) -> float:
        """Time from the first scan to the last [s], 0 before the first."""
        return self._intake.duration_s if self._scans.has_own else 0.0

    @property
    def last_stamp(self) -> float:
        """Stamp of the last mapped scan [s], NaN before the first."""
        return self._scans.last_stamp

    def node_stamps(self, first: int) -> FloatArray:
        """Return the stamps [s] of the graph's nodes from `first` on, shape (n,)."""
        return self._scans.node_stamps(first, self._global_slam.graph.num_nodes)

    def add(self, event: SensorEvent, on_pose: Callable[[], None] | None = None) -> Pose | None:
        """Add one sensor event. Bad data does not raise: it is skipped, and counted by reason.

        A scan that is measured beam by beam is queued until odometry and IMU cover its sweep.

        Parameters
        ----------
        on_pose : called for each mapped scan as soon as `pose` is its pose, before the scan is
            inserted into the submaps; must be quick.

        Returns
        -------
        The pose of the last scan that this call mapped, map frame as adjusted so far; None if it
        mapped none.

        Raises
        ------
        InputError
            The pose is further away than any map could reach. `result` still returns what was
            mapped before.
        UsageError
            It is no event, or the map is finished.
        """
        if self._is_closed:
            raise UsageError("Mapper.add: the map is finished; map further events in a new Mapper")
        if self._clock is None:
            self._clock = RunClock()
        if not self._intake.take(event):
            return None
        # Live, the sequencer has already waited for late readings.
        return self._map_queue(math.inf if self._back_end is not None else event.time, on_pose)

    def finish(self, note: Callable[[str], None] | None = None) -> Result:
        """Close the last loops, adjust all poses and return the map; no event may follow.

        Called again, it returns the same map.

        Parameters
        ----------
        note : called with a description of each step as it begins, in this thread.

        Raises
        ------
        UsageError
            The mapper was closed before, or finishing has failed; `result` returns what was mapped.
        """
        if self._finished is not None:
            return self._finished
        if self._is_closed:
            raise UsageError(
                "Mapper.finish: the mapper was closed before it was finished, or finishing failed; "
                "result() returns what was mapped"
            )
        try:
            self._map_queue(math.inf)
            if (failure := self._end_back_end()) is not None:
                raise failure
            self._global_slam.finish(self._local_slam.active_submaps, note)
            finished = finished_map(self._global_slam, self.result, self._config, self._timer, note)
            self._finished = replace(finished, report=self._timed(finished.report))
        finally:
            self.close()
        return self._finished

    def close(self) -> None:
        """Stop the background threads and drop their searches; only `result` may follow."""
        self._is_closed = True
        self._end_back_end()
        self._global_slam.close()

    def run_on_graph_thread(self, task: Callable[[], None]) -> None:
        """Run a task while the pose graph does not change, with all nodes so far in it.

        Immediately; in live mapping later, in the thread of the graph, while local SLAM continues.
        """
        if self._back_end is None:
            task()
        else:
            self._back_end.call(task)

    def call_with_result(self, receive: Callable[[Result], None]) -> None:
        """Call `receive` with the present map, as by `run_on_graph_thread`, without waiting.

        The map is a copy: later mapping does not change it.
        """
        num_scans, active = len(self._scans), self._local_slam.active_submaps

        def hand_over() -> None:
            result = self._result(num_scans, active)
            graph = result.graph
            receive(replace(result, graph=graph.copy(), closures=result.closures.copy()))

        self.run_on_graph_thread(hand_over)

    def result(self) -> Result:
        """Return the present map, without waiting for searches.

        In live mapping, only after `close`; see `call_with_result`.
        """
        return self._result(len(self._scans), self._local_slam.active_submaps)

    def _result(self, num_scans: int, active: Sequence[Submap]) -> Result:
        """Return the map of the first `num_scans` mapped scans and these growing submaps."""
        graph = self._global_slam.graph
        node_scan_index = self._scans.node_scan_index(graph.num_nodes)
        stamps, local = self._scans.rows(num_scans)
        sessions = self.sessions
        trajectory = whole_trajectory(sessions, local, node_scan_index, graph.node_poses)
        return Result(
            stamps,
            trajectory,
            local,
            graph,
            node_scan_index,
            self._submap_grids(graph, active),
            self._config,
            self._report(graph, trajectory),
            closures=self._global_slam.closures,
            node_points=self._global_slam.node_points,
            sessions=sessions,
        )

    @property
    def sessions(self) -> tuple[Session, ...]:
        """All sessions, the last of them the one that is mapped, with the parts so far."""
        own = self._scans.session(self.calibration)
        return with_parts([*self._earlier.sessions, own], self._global_slam.sessions)

    def _map_queue(self, time: float, on_pose: Callable[[], None] | None = None) -> Pose | None:
        """Map the queued scans whose sweeps ended before a time; return the last pose."""
        pose = None
        for scan in self._intake.ready_scans(time):
            self._map_scan(scan, on_pose)
            pose = self.pose
        return pose

    def _map_scan(self, scan: LaserScan | PointCloud, on_pose: Callable[[], None] | None) -> None:
        def publish(tf_local_tracking: Pose) -> None:
            self._local_pose = tf_local_tracking
            if on_pose is not None:
                on_pose()

        self._last_scan = result = self._local_slam.add_scan(scan, publish)
        if not result.was_matched and result.node is None:
            self._intake.skipped["too few returns to match: pose as predicted"] += 1
        self._scans.add(scan, result.tf_local_tracking, is_node=result.node is not None)
        if result.node is not None:
            (self._back_end or self._global_slam).add_node(result.node)

    def _end_back_end(self) -> Exception | None:
        """Add all nodes and stop the thread of the graph; return its failure, if any."""
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
        slam, path = self._global_slam, path_length(trajectory[self._scans.first :])
        own = InputSummary(scans=self.num_scans, duration_s=self.recorded_s, path_length_m=path)
        report = Report(
            input=self._earlier.summary(own),
            nodes=graph.num_nodes,
            submaps=graph.num_submaps,
            constraints=summarize_constraints(graph, slam.closures),
            adjustment=AdjustmentSummary.of_runs(slam.adjustments),
            stages=self._timer.summary(),
            skipped=self._earlier.skipped(self.skipped),
            extra=self._local_slam.summary() | slam.summary() | {"sensors": self._scans.sensors()},
        )
        return self._timed(report)

    def _timed(self, report: Report) -> Report:
        """Return a report with the time since the first event."""
        return self._clock.timed(report) if self._clock else report
