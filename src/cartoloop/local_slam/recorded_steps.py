# SPDX-License-Identifier: Apache-2.0
"""The steps of local SLAM in the journal of a run: recorded, or taken from there on resuming."""

from __future__ import annotations

import json
from collections.abc import Callable

from cartoloop.journal.frames import Kind
from cartoloop.journal.outcomes import RecordedOutcomes, unfit
from cartoloop.local_slam.match_records import (
    match_record,
    recorded_match,
    recorded_wall_step,
    wall_record,
)
from cartoloop.local_slam.scan_matcher import MatchedScan, ScanMatcher, matched_scan
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.local_slam.wall_step import WallStep
from cartoloop.sensor.pose import Pose
from cartoloop.submaps.node import Node
from cartoloop.submaps.node_records import node_record, scan_record
from cartoloop.submaps.submap import Submap


class RecordedSteps:
    """Computes what the journal does not hold, and records it.

    Parameters
    ----------
    outcomes : of local SLAM in the run.
    """

    def __init__(self, outcomes: RecordedOutcomes) -> None:
        self._outcomes = outcomes

    def match(
        self, matcher: ScanMatcher, submap: Submap, compute: Callable[[], MatchedScan]
    ) -> MatchedScan:
        """Return the match of a scan to a submap, and leave the matcher as after it."""
        if (recorded := self._outcomes.replay(Kind.MATCH)) is not None:
            match, matcher.memory, is_relocated = recorded_match(recorded)
            return matched_scan(submap, match, is_relocated=is_relocated)
        matched = compute()
        if self._outcomes.is_replayable:
            record = match_record(matched.match, matcher.memory, is_relocated=matched.is_relocated)
            self._outcomes.record(Kind.MATCH, record)
        return matched

    def wall_step(self, wall_step: WallStep, compute: Callable[[], Pose | None]) -> Pose | None:
        """Return a better pose along bare walls, and leave the comparison as after it."""
        if (recorded := self._outcomes.replay(Kind.WALL_STEP)) is not None:
            better, wall_step.memory = recorded_wall_step(recorded)
            return better
        better = compute()
        if self._outcomes.is_replayable:
            self._outcomes.record(Kind.WALL_STEP, wall_record(better, wall_step.memory))
        return better

    def add_scan(self, stamp: float, pose: Pose) -> None:
        """Record a mapped scan, or check that it is the same as recorded.

        Raises
        ------
        InputError
            It is not.
        """
        if not self._outcomes.is_recording:
            return
        record = scan_record(stamp, pose)
        recorded = self._outcomes.replay(Kind.SCAN)
        if recorded is None:
            self._outcomes.record(Kind.SCAN, record)
        elif recorded != record:
            raise unfit(f"the scan with stamp {stamp:.6f} has another pose")

    def add_node(self, node: Node, tf_tracking_sensor: Pose) -> None:
        """Record a node."""
        if self._outcomes.replay(Kind.NODE) is None and self._outcomes.is_recording:
            self._outcomes.record(Kind.NODE, node_record(node, tf_tracking_sensor))

    def add_calibration(self, calibration: SensorCalibration) -> None:
        """Record what is known about the sensors."""
        if self._outcomes.replay(Kind.CALIBRATION) is None and self._outcomes.is_recording:
            self._outcomes.record(Kind.CALIBRATION, json.dumps(calibration.to_dict()).encode())
