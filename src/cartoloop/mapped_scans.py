# SPDX-License-Identifier: Apache-2.0
"""The scans of a map that grows: their stamps and local poses, and which of them are nodes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.earlier_sessions import EarlierMaps
from cartoloop.growing_array import GrowingArray
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.packed_rows import PackedRows
from cartoloop.report import summarize_sensor
from cartoloop.sensor.events import CloudGeometry, LaserScan, PointCloud, ScanGeometry
from cartoloop.sensor.pose import Pose
from cartoloop.session import Session


class MappedScans:
    """The scans of earlier sessions, and those of a session that is mapped now.

    Parameters
    ----------
    earlier : maps that mapping goes on from.

    Attributes
    ----------
    first : index of the first scan of the session.
    last_stamp : of its last scan [s], NaN before the first.
    """

    def __init__(self, earlier: EarlierMaps) -> None:
        self._rows = PackedRows(4)  # stamp and tf_local_tracking of each
        self._rows.extend(np.column_stack((earlier.stamps, earlier.local_poses)))
        self.first = len(earlier.stamps)
        self._first_node = len(earlier.node_scan_index)
        self._first_submap = earlier.num_submaps
        self._first_stamp = self.last_stamp = math.nan
        self._node_scan_index: list[int] = earlier.node_scan_index.tolist()
        self._node_stamps = GrowingArray((), np.float64)
        self._node_stamps.extend(earlier.stamps[earlier.node_scan_index])
        self._sensors: dict[str, ScanGeometry | CloudGeometry] = {}

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def num_nodes(self) -> int:
        """Number of scans that became nodes of the pose graph."""
        return len(self._node_scan_index)

    @property
    def has_own(self) -> bool:
        """Whether a scan of the session was mapped."""
        return len(self._rows) > self.first

    def add(self, scan: LaserScan | PointCloud, tf_local_tracking: Pose, *, is_node: bool) -> None:
        """Add a mapped scan of the session."""
        if not self.has_own:
            self._first_stamp = float(scan.stamp)
        self.last_stamp = float(scan.stamp)
        self._sensors.setdefault(scan.geometry.sensor, scan.geometry)
        self._rows.append((scan.stamp, *tf_local_tracking))
        if is_node:
            self._node_scan_index.append(len(self._rows) - 1)
            self._node_stamps.append(scan.stamp)

    def rows(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return stamps [s] and local poses of the first scans, shapes (count,), (count, 3)."""
        rows = self._rows.rows(count)
        return rows[:, 0].copy(), rows[:, 1:].copy()

    def node_scan_index(self, num_nodes: int) -> NDArray[np.int64]:
        """Return the scans of the first nodes, shape (num_nodes,)."""
        return np.array(self._node_scan_index[:num_nodes], dtype=np.int64)

    def node_stamps(self, first: int, end: int) -> FloatArray:
        """Return the stamps [s] of the nodes from `first` to before `end`, shape (n,)."""
        stamps: FloatArray = self._node_stamps.view[first:end]
        return stamps.copy()

    def session(self, calibration: SensorCalibration) -> Session:
        """Return the session that is mapped.

        Parameters
        ----------
        calibration : what is known about its sensors by now.
        """
        return Session(
            first_scan=self.first,
            first_node=self._first_node,
            first_submap=self._first_submap,
            stamp=self._first_stamp,
            calibration=calibration.to_dict(),
        )

    def sensors(self) -> list[dict[str, Any]]:
        """Return what is to be known of the scanners of the session, for the report."""
        return [summarize_sensor(sensor) for _, sensor in sorted(self._sensors.items())]
