# SPDX-License-Identifier: Apache-2.0
"""A raw scan to the points that are matched and inserted (section IV-A)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import AdaptiveVoxelFilterConfig, SensorConfig
from cartoloop.kernels.cloud_projection import CloudLimits, project_cloud
from cartoloop.kernels.range_projection import Position, RangeLimits, project_and_thin
from cartoloop.kernels.sweep_projection import Heights, project_sweep
from cartoloop.kernels.voxel_filter import adaptive_voxel_filter, voxel_filter
from cartoloop.sensor.blocked_beams import BlockedBeams
from cartoloop.sensor.events import CloudGeometry, LaserScan, PointCloud, ScanGeometry
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.range_noise import NO_NOISE, Noise, RangeNoise
from cartoloop.sensor.slanting_walls import without_hidden
from cartoloop.sensor.sweep_motion import AT_REST, SweepMotion, rotation, sensor_in_sweep
from cartoloop.sensor.wall_smoothing import smoothed

ANGLE_TOLERANCE = 0.01
"""Part of a beam's step by which recorded steps are rounded."""

_MAX_GEOMETRIES = 64
"""Number of geometries that are cached; only wrong readers make a new one for each scan."""


class RangeData(NamedTuple):
    """The ends of a scan's beams.

    Attributes
    ----------
    tf_tracking_sensor : start of the beams; of a moving scanner, its pose in the middle of the
        sweep.
    returns, misses : float64, shapes (n, 2), (k, 2) [m], tracking frame: ends of beams with a
        return, and of the free space along beams without one.
    noise : of the ranges, if they are noisy.
    """

    tf_tracking_sensor: Pose
    returns: FloatArray
    misses: FloatArray
    noise: Noise = NO_NOISE


@dataclass(frozen=True, slots=True)
class _Scanner:
    """What depends only on the geometry of a laser scanner and on the configuration.

    Attributes
    ----------
    geometry : referenced, so that no other object gets its identity.
    mounting, origin : pose seen from above, and position.
    directions : unit vectors of the beams, tracking frame, float64, shape (num_beams, 3); of a
        level scanner, shape (num_beams, 2).
    limits : which beams are hits.
    blocked : knows which beams never have a return.
    noise : knows up to where returns are useful.
    """

    geometry: ScanGeometry
    mounting: Pose
    origin: Position
    directions: FloatArray
    limits: RangeLimits
    blocked: BlockedBeams
    noise: RangeNoise


@dataclass(frozen=True, slots=True)
class _CloudScanner:
    """What depends only on the geometry of a scanner of point clouds and on the configuration.

    Attributes
    ----------
    geometry : referenced, so that no other object gets its identity.
    origin : position on the robot.
    rotation : float64, shape (3, 3), sensor frame to tracking frame.
    limits : which points are used.
    """

    geometry: CloudGeometry
    origin: Position
    rotation: FloatArray
    limits: CloudLimits


class RangeFilter:
    """Crops and thins scans as configured; caches what depends only on a scanner's geometry."""

    def __init__(self, config: SensorConfig) -> None:
        self._config = config
        self._scanners: dict[int, _Scanner] = {}
        self._cloud_scanners: dict[int, _CloudScanner] = {}
        self._blocked: dict[tuple[str, int], BlockedBeams] = {}
        self._noise: dict[tuple[str, int], RangeNoise] = {}
        self._heights = Heights(config.min_z, config.max_z)
        self._first_sensor: str | None = None

    @property
    def useful_ranges(self) -> dict[str, float]:
        """By scanner, up to where returns are used [m], if noise beyond is too large."""
        return {
            name: noise.useful_range
            for (name, _), noise in sorted(self._noise.items())
            if self._config.max_range is None and math.isfinite(noise.useful_range)
        }

    def apply(self, scan: LaserScan | PointCloud, motion: SweepMotion | None = None) -> RangeData:
        """Return the scan's beams, cropped to the useful ranges, one return per voxel.

        Parameters
        ----------
        scan : of a laser scanner, or a point cloud, whose nearest point in each direction is used.
        motion : of the robot during the sweep; None if it is level and at rest. Points are
            deskewed: in the level frame of the robot at the time of the scan.
        """
        if isinstance(scan, PointCloud):
            return self._apply_to_cloud(scan, motion or AT_REST)
        geometry = scan.geometry
        scanner = self._scanners.get(id(geometry)) or self._add_scanner(geometry)
        limits = scanner.limits
        scanner.noise.add(scan.ranges, limits.min_range, limits.no_return_range)
        if self._config.max_range is None and scanner.noise.useful_range < limits.max_range:
            limits = limits._replace(max_range=scanner.noise.useful_range)
        ranges = scanner.blocked.apply(scan.ranges, limits.min_range, limits.no_return_range)
        if self._config.smooth_walls:
            ranges = smoothed(
                ranges, geometry.angle_increment, limits.min_range, limits.no_return_range
            )
        if geometry.no_return_is_free:
            ranges = without_hidden(
                ranges,
                geometry.angle_increment,
                limits.min_range,
                limits.no_return_range,
                limits.free_ray_length,
            )
        returns = np.empty((geometry.num_beams, 2))
        misses = np.empty((geometry.num_beams, 2))
        mounting, edge = scanner.mounting, self._config.voxel_filter_size
        if motion is None and geometry.is_level:
            num_returns, num_misses = project_and_thin(
                ranges,
                scanner.directions,
                scanner.origin[:],
                limits[:],
                edge,
                returns,
                misses,
            )
        else:
            motion = motion or AT_REST
            num_returns, num_misses = project_sweep(
                ranges,
                _in_space(scanner.directions),
                scanner.origin,
                geometry.time_increment,
                motion,
                limits,
                self._heights,
                returns,
                misses,
            )
            mounting = sensor_in_sweep(mounting, geometry.height, motion)
            num_returns = voxel_filter(returns, num_returns, edge, returns)
            num_misses = voxel_filter(misses, num_misses, edge, misses)
        return RangeData(mounting, returns[:num_returns], misses[:num_misses], scanner.noise.noise)

    def _apply_to_cloud(self, cloud: PointCloud, motion: SweepMotion) -> RangeData:
        geometry, config = cloud.geometry, self._config
        scanner = self._cloud_scanners.get(id(geometry)) or self._add_cloud_scanner(geometry)
        sensor = sensor_in_sweep(geometry.tf_tracking_sensor, geometry.height, motion)
        returns = np.empty((config.cloud_directions, 2))
        num_returns = project_cloud(
            cloud.points,
            np.empty(0) if cloud.times is None else cloud.times,
            scanner.rotation,
            scanner.origin,
            motion,
            scanner.limits,
            sensor.x,
            sensor.y,
            np.empty(config.cloud_directions),
            returns,
        )
        num_returns = voxel_filter(returns, num_returns, config.voxel_filter_size, returns)
        return RangeData(sensor, returns[:num_returns], np.empty((0, 2)))

    def _add_scanner(self, geometry: ScanGeometry) -> _Scanner:
        config, mounting = self._config, geometry.tf_tracking_sensor
        if self._first_sensor is None:
            self._first_sensor = geometry.sensor
        if config.laser_pose is not None and geometry.sensor == self._first_sensor:
            mounting = Pose(*config.laser_pose)
        beams = mirrored(geometry) if config.upside_down else geometry
        if len(self._scanners) >= _MAX_GEOMETRIES:
            self._scanners.clear()
        key = geometry.sensor, geometry.num_beams
        scanner = self._scanners[id(geometry)] = _Scanner(
            geometry,
            mounting,
            _position(mounting, geometry.height),
            _beam_directions(beams, mounting),
            RangeLimits(
                self._min_range(geometry),
                self._max_range(geometry.range_max),
                float(geometry.range_max),
                bool(geometry.no_return_is_free),
                config.missing_data_ray_length,
                self._num_agreeing(geometry),
            ),
            self._blocked.setdefault(
                key, BlockedBeams(geometry.num_beams, geometry.angle_increment)
            ),
            self._noise.setdefault(key, RangeNoise(geometry.angle_increment)),
        )
        return scanner

    def _add_cloud_scanner(self, geometry: CloudGeometry) -> _CloudScanner:
        config, mounting = self._config, geometry.tf_tracking_sensor
        min_z, max_z = geometry.min_z, geometry.max_z
        if math.isinf(min_z) and math.isinf(max_z):
            min_z = geometry.height - config.cloud_below
            max_z = geometry.height + config.cloud_above
        if len(self._cloud_scanners) >= _MAX_GEOMETRIES:
            self._cloud_scanners.clear()
        scanner = self._cloud_scanners[id(geometry)] = _CloudScanner(
            geometry,
            _position(mounting, geometry.height),
            rotation(geometry.roll, geometry.pitch, mounting.theta),
            CloudLimits(
                self._min_range(geometry),
                min(float(geometry.range_max), self._max_range(math.inf)),
                float(max(min_z, config.min_z)),
                float(min(max_z, config.max_z)),
            ),
        )
        return scanner

    def _min_range(self, geometry: ScanGeometry | CloudGeometry) -> float:
        configured = self._config.min_range
        return float(geometry.range_min if configured is None else configured)

    def _num_agreeing(self, geometry: ScanGeometry) -> int:
        """Return how many beams on each side of one without a return must agree with it."""
        angle = math.radians(self._config.missing_data_agreement_deg)
        if angle == 0.0 or geometry.angle_increment == 0.0:
            return 0
        share = min(angle / abs(geometry.angle_increment), geometry.num_beams)
        return max(math.floor(share + ANGLE_TOLERANCE), 1)

    def _max_range(self, range_max: float) -> float:
        """Return the largest range of a hit [m], given the scanner's own limit."""
        config = self._config
        if config.max_range is not None:
            return config.max_range
        return float(min(range_max, config.default_max_range))


def mirrored(geometry: ScanGeometry) -> ScanGeometry:
    """Return a geometry with left and right exchanged."""
    return replace(
        geometry, angle_min=-geometry.angle_min, angle_increment=-geometry.angle_increment
    )


def _position(mounting: Pose, height: float) -> Position:
    return Position(float(mounting.x), float(mounting.y), float(height))


def _beam_directions(geometry: ScanGeometry, mounting: Pose) -> FloatArray:
    """Return unit vectors of the beams in the tracking frame, shape (n, 2), tilted ones (n, 3)."""
    if geometry.is_level:
        angles = geometry.angles + mounting.theta
        return np.column_stack((np.cos(angles), np.sin(angles)))
    angles = geometry.angles
    in_sensor = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(len(angles))))
    turned = in_sensor @ rotation(geometry.roll, geometry.pitch, mounting.theta).T
    return np.ascontiguousarray(turned)


def _in_space(directions: FloatArray) -> FloatArray:
    """Return the beams' directions with three components."""
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
