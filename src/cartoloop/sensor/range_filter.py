# SPDX-License-Identifier: Apache-2.0
"""A raw scan to the points that are matched and inserted (section IV-A)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cartoloop.config import AdaptiveVoxelFilterConfig, SensorConfig
from cartoloop.kernels.cloud_projection import project_cloud
from cartoloop.kernels.range_projection import project_ranges
from cartoloop.kernels.sweep_projection import project_sweep
from cartoloop.kernels.voxel_filter import adaptive_voxel_filter, voxel_filter
from cartoloop.sensor.events import CloudGeometry, LaserScan, PointCloud, ScanGeometry
from cartoloop.sensor.pose import FloatArray, Pose
from cartoloop.sensor.sweep_motion import (
    AT_REST,
    SweepMotion,
    is_level,
    rotation,
    sensor_in_sweep,
)

USEFUL_RANGE = 30.0
"""Beyond this the beams of common scanners lie so far apart that their returns tell little [m]."""

CLOUD_DIRECTIONS = 720
"""In so many directions a cloud has one return, its nearest."""

CLOUD_BELOW, CLOUD_ABOVE = 0.3, 0.7
"""The part of a cloud that counts where nothing is told of it: so far below its scanner, where
there is no floor yet, and so far above [m]."""

_MAX_GEOMETRIES = 64


class RangeData(NamedTuple):
    """The ends of a scan's beams.

    Attributes
    ----------
    tf_tracking_sensor : where the beams start; where they do so from several places, the middle.
    returns, misses : float64, shapes (n, 2), (k, 2) [m], tracking frame: ends of beams that hit
        something, and of those that met nothing as far as that.
    """

    tf_tracking_sensor: Pose
    returns: FloatArray
    misses: FloatArray


@dataclass(frozen=True, slots=True)
class _Scanner:
    """What depends on a scanner's geometry alone.

    Attributes
    ----------
    geometry : held, so that no other object gets its identity.
    mounting : seen from above.
    directions : of the beams, float64, shape (num_beams, 2) or, if it is tilted, also the third
        component; (3, 3) for clouds: sensor frame to tracking frame.
    """

    geometry: ScanGeometry | CloudGeometry
    mounting: Pose
    directions: FloatArray


class RangeFilter:
    """Crops and thins scans as configured; keeps what depends on the beams' geometry alone."""

    def __init__(self, config: SensorConfig) -> None:
        self._config = config
        self._scanners: dict[int, _Scanner] = {}
        self._first_sensor: str | None = None

    def apply(self, scan: LaserScan | PointCloud, motion: SweepMotion | None = None) -> RangeData:
        """Return the scan's beams, cropped to the useful ranges, one return per voxel.

        Parameters
        ----------
        scan : of a scanner, or a cloud, of which the nearest point of each direction counts.
        motion : the robot's during the sweep; None if it stands level and still. Points are where
            they would have been seen at the time of the scan, by a level robot.
        """
        known = self._scanners.get(id(scan.geometry)) or self._take_in(scan.geometry)
        if isinstance(scan, PointCloud):
            return self._apply_to_cloud(scan, known, motion or AT_REST)
        geometry, config = scan.geometry, self._config
        returns = np.empty((geometry.num_beams, 2))
        misses = np.empty((geometry.num_beams, 2))
        limits = (
            geometry.range_min if config.min_range is None else config.min_range,
            min(geometry.range_max, USEFUL_RANGE) if config.max_range is None else config.max_range,
            geometry.range_max,
        )
        sensor = known.mounting
        if motion is None and is_level(geometry):
            num_returns, num_misses = project_ranges(
                scan.ranges,
                known.directions,
                *limits,
                geometry.no_return_is_free,
                config.missing_data_ray_length,
                known.mounting.x,
                known.mounting.y,
                returns,
                misses,
            )
        else:
            motion = motion or AT_REST
            num_returns, num_misses = project_sweep(
                scan.ranges,
                _in_space(known),
                np.array((sensor.x, sensor.y, geometry.height)),
                geometry.time_increment,
                *motion,
                np.array((*limits, config.missing_data_ray_length, config.min_z, config.max_z)),
                geometry.no_return_is_free,
                returns,
                misses,
            )
            sensor = sensor_in_sweep(sensor, geometry.height, motion)
        edge = config.voxel_filter_size
        num_returns = voxel_filter(returns, num_returns, edge, returns)
        num_misses = voxel_filter(misses, num_misses, edge, misses)
        return RangeData(sensor, returns[:num_returns], misses[:num_misses])

    def _apply_to_cloud(self, cloud: PointCloud, known: _Scanner, motion: SweepMotion) -> RangeData:
        config, geometry, mounting = self._config, cloud.geometry, known.mounting
        sensor = sensor_in_sweep(mounting, geometry.height, motion)
        min_z, max_z = geometry.min_z, geometry.max_z
        if math.isinf(min_z) and math.isinf(max_z):
            min_z, max_z = geometry.height - CLOUD_BELOW, geometry.height + CLOUD_ABOVE
        max_range = USEFUL_RANGE if config.max_range is None else config.max_range
        returns = np.empty((CLOUD_DIRECTIONS, 2))
        num_returns = project_cloud(
            cloud.points,
            np.empty(0) if cloud.times is None else cloud.times,
            known.directions,
            np.array((mounting.x, mounting.y, geometry.height)),
            *motion,
            np.array(
                (
                    geometry.range_min if config.min_range is None else config.min_range,
                    min(geometry.range_max, max_range),
                    max(min_z, config.min_z),
                    min(max_z, config.max_z),
                )
            ),
            sensor.x,
            sensor.y,
            np.empty(CLOUD_DIRECTIONS),
            returns,
        )
        num_returns = voxel_filter(returns, num_returns, config.voxel_filter_size, returns)
        return RangeData(sensor, returns[:num_returns], np.empty((0, 2)))

    def _take_in(self, geometry: ScanGeometry | CloudGeometry) -> _Scanner:
        """Return what depends on the geometry, which is new."""
        if len(self._scanners) >= _MAX_GEOMETRIES:
            self._scanners.clear()
        mounting = geometry.tf_tracking_sensor
        if isinstance(geometry, CloudGeometry):
            directions = rotation(geometry.roll, geometry.pitch, mounting.theta)
        else:
            if self._first_sensor is None:
                self._first_sensor = geometry.sensor
            if self._config.laser_pose is not None and geometry.sensor == self._first_sensor:
                mounting = Pose(*self._config.laser_pose)
            directions = _beam_directions(geometry, mounting)
        known = self._scanners[id(geometry)] = _Scanner(geometry, mounting, directions)
        return known


def _beam_directions(geometry: ScanGeometry, mounting: Pose) -> FloatArray:
    """Return unit vectors of the beams in the tracking frame, shape (n, 2), tilted ones (n, 3)."""
    if is_level(geometry):
        angles = geometry.angles + mounting.theta
        return np.column_stack((np.cos(angles), np.sin(angles)))
    angles = geometry.angles
    in_sensor = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(len(angles))))
    turned = in_sensor @ rotation(geometry.roll, geometry.pitch, mounting.theta).T
    return np.ascontiguousarray(turned)


def _in_space(known: _Scanner) -> FloatArray:
    """Return the beams' directions with three components."""
    directions = known.directions
    if directions.shape[1] == 3:
        return directions
    return np.column_stack((directions, np.zeros(len(directions))))


def thin(points: FloatArray, config: AdaptiveVoxelFilterConfig) -> FloatArray:
    """Return the points, shape (n, 2) [m], after the coarsest voxel filter that keeps enough."""
    thinned = np.empty_like(points)
    kept = adaptive_voxel_filter(
        points, config.max_length, config.min_num_points, config.max_range, thinned
    )
    return thinned[:kept].copy()  # a view would keep the memory of all
