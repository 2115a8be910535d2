# SPDX-License-Identifier: Apache-2.0
"""Calibration of odometry: local SLAM on the part of a recording with the most rotation."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import Config
from cartoloop.doctor.odometry import OdometryWatch
from cartoloop.local_slam.local_slam import LocalSlam
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.quality.odometry_use import turns_against
from cartoloop.readers.log import Log
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.event_faults import fault_of
from cartoloop.sensor.events import Imu, LaserScan, Odometry, SensorEvent

PART_SCANS = 1500
"""Scans of the part that is matched: enough for an estimate, and matched within seconds."""

MIN_SCANS = 50
"""Minimum number of scans for an estimate."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """Result of local SLAM on a part of a recording.

    Attributes
    ----------
    first_scan, num_scans : which part.
    num_matched : scans that could be matched.
    model : of the odometry.
    is_mirrored : whether the odometry turns to the other side than the scans.
    """

    first_scan: int
    num_scans: int
    num_matched: int
    model: OdometryParameters
    is_mirrored: bool


def choose_part(scan_times: FloatArray, odometry: OdometryWatch, size: int = PART_SCANS) -> int:
    """Return the first scan of the stretch of `size` scans in which the robot turns most.

    Parameters
    ----------
    scan_times : float64, shape (n,) [s].
    """
    if len(scan_times) <= size or odometry.count < 2:
        return 0
    turned = odometry.turned_until(scan_times)
    return int(np.argmax(turned[size:] - turned[:-size]))


def calibrate(
    log: Log, scan_times: FloatArray, odometry: OdometryWatch, sensor: str
) -> Calibration | None:
    """Run local SLAM over a part of a recording; None if there is too little data.

    Parameters
    ----------
    scan_times : of the main scanner [s].
    sensor : name of the main scanner, whose scans are matched.
    """
    if len(scan_times) < MIN_SCANS or odometry.count < MIN_SCANS or odometry.path_length == 0.0:
        return None
    first = choose_part(scan_times, odometry)
    start = float(scan_times[first])
    end = float(scan_times[min(first + PART_SCANS, len(scan_times)) - 1])
    config = Config()
    node_filter = config.global_slam.constraint_search.adaptive_voxel_filter
    slam = LocalSlam(config.local_slam, config.sensor, node_filter, StageTimer())
    num_scans = num_matched = 0
    last = -np.inf
    for event in _between(log, start, end):
        if event.time < last or fault_of(event):
            continue
        if isinstance(event, Odometry):
            slam.add_odometry(event)
        elif isinstance(event, Imu):
            slam.add_imu(event)
        elif isinstance(event, LaserScan) and event.geometry.sensor == sensor and event.time > last:
            num_matched += slam.add_scan(event).was_matched
            num_scans += 1
            last = event.time
    return Calibration(
        first,
        num_scans,
        num_matched,
        slam.extrapolator.odometry.model,
        turns_against(slam.summary()["odometry"]),
    )


def _between(log: Log, start: float, end: float) -> Iterator[SensorEvent]:
    """Yield the events of a stretch of time."""
    with closing(iter(log)) as events:
        for event in events:
            if event.time > end:
                return
            if event.time >= start:
                yield event
