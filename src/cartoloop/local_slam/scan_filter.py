# SPDX-License-Identifier: Apache-2.0
"""Scans as they are matched: deskewed, filtered by range, and thinned."""

from __future__ import annotations

from typing import NamedTuple

from cartoloop.arrays import FloatArray
from cartoloop.config import AdaptiveVoxelFilterConfig, SensorConfig
from cartoloop.sensor.events import LaserScan, PointCloud
from cartoloop.sensor.range_filter import RangeData, RangeFilter, thin
from cartoloop.sensor.sweep_motion import SweepMotion


class FilteredScan(NamedTuple):
    """A scan after deskewing and filtering.

    Attributes
    ----------
    motion : the motion during the sweep that was assumed; None without any.
    data : ends of the beams.
    points : float64, shape (n, 2), the returns to match [m], tracking frame.
    """

    motion: SweepMotion | None
    data: RangeData
    points: FloatArray


class ScanFilter:
    """Filters scans, and keeps which ranges of each scanner are useful.

    Parameters
    ----------
    sensor : which part of a scan is used.
    voxel_filter : of the points to match.
    """

    def __init__(self, sensor: SensorConfig, voxel_filter: AdaptiveVoxelFilterConfig) -> None:
        self._range_filter = RangeFilter(sensor)
        self._voxel_filter = voxel_filter

    @property
    def useful_ranges(self) -> dict[str, float]:
        """By scanner, up to where returns are used [m], if noise beyond is too large."""
        return self._range_filter.useful_ranges

    def apply(self, scan: LaserScan | PointCloud, motion: SweepMotion | None) -> FilteredScan:
        """Return a scan deskewed by a motion during its sweep."""
        data = self._range_filter.apply(scan, motion)
        return FilteredScan(motion, data, thin(data.returns, self._voxel_filter))
