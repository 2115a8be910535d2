# SPDX-License-Identifier: Apache-2.0
"""A raw scan to the points that are matched and inserted (section IV-A)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.config import AdaptiveVoxelFilterConfig, SensorConfig
from cartoloop.kernels.range_projection import project_ranges
from cartoloop.kernels.voxel_filter import adaptive_voxel_filter, voxel_filter
from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.pose import FloatArray, Pose

USEFUL_RANGE = 30.0
"""Beyond this the beams of common scanners lie so far apart that their returns tell little [m]."""


class RangeData(NamedTuple):
    """The ends of a scan's beams.

    Attributes
    ----------
    tf_tracking_sensor : where the beams start.
    returns, misses : float64, shapes (n, 2), (k, 2) [m], tracking frame: ends of beams that hit
        something, and of those that met nothing as far as that.
    """

    tf_tracking_sensor: Pose
    returns: FloatArray
    misses: FloatArray


class RangeFilter:
    """Crops and thins scans as configured; keeps what depends on the beams' geometry alone."""

    def __init__(self, config: SensorConfig) -> None:
        self._config = config
        self._geometry: ScanGeometry | None = None
        self._directions = np.zeros((0, 2))

    def apply(self, scan: LaserScan) -> RangeData:
        """Return the scan's beams, cropped to the useful ranges, one return per voxel."""
        config, geometry = self._config, scan.geometry
        mounting = (
            geometry.tf_tracking_sensor if config.laser_pose is None else Pose(*config.laser_pose)
        )
        if geometry is not self._geometry:
            self._geometry = geometry
            angles = geometry.angles + mounting.theta
            self._directions = np.column_stack((np.cos(angles), np.sin(angles)))
        returns = np.empty((geometry.num_beams, 2))
        misses = np.empty((geometry.num_beams, 2))
        num_returns, num_misses = project_ranges(
            scan.ranges,
            self._directions,
            geometry.range_min if config.min_range is None else config.min_range,
            min(geometry.range_max, USEFUL_RANGE) if config.max_range is None else config.max_range,
            geometry.range_max,
            geometry.no_return_is_free,
            config.missing_data_ray_length,
            mounting.x,
            mounting.y,
            returns,
            misses,
        )
        edge = config.voxel_filter_size
        num_returns = voxel_filter(returns, num_returns, edge, returns)
        num_misses = voxel_filter(misses, num_misses, edge, misses)
        return RangeData(mounting, returns[:num_returns], misses[:num_misses])


def thin(points: FloatArray, config: AdaptiveVoxelFilterConfig) -> FloatArray:
    """Return the points, shape (n, 2) [m], after the coarsest voxel filter that keeps enough."""
    thinned = np.empty_like(points)
    kept = adaptive_voxel_filter(
        points, config.max_length, config.min_num_points, config.max_range, thinned
    )
    return thinned[:kept].copy()  # a view would keep the memory of all
