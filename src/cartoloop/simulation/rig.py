# SPDX-License-Identifier: Apache-2.0
"""Simulated scanners that are mounted tilted, move during a sweep, or measure 3D clouds."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import ConfigError
from cartoloop.sensor.events import CloudGeometry, ScanGeometry
from cartoloop.simulation.gait import turned
from cartoloop.simulation.lidar import Lidar, walls_within

FLOOR, CEILING = -1.1, 1.7
"""Heights of floor and ceiling relative to the body's origin [m]: a scanner carried at the hip in
a room of 2.8 m."""


@dataclass(frozen=True, slots=True)
class MountedLidar:
    """A scanner on a body that may tilt and move during a sweep.

    Attributes
    ----------
    lidar : its beams, rate and noise, and its planar mounting.
    name : of the scanner.
    height, roll, pitch : the rest of its mounting [m], [rad].
    sweep : time from the first to the last beam [s]; 0: all beams at once.
    delay : of the first scan [s].
    clock_offset : its stamps are so much later than the scans [s].
    elevations : of the rings of beams [rad]; more than one makes clouds of points.
    """

    lidar: Lidar = field(default_factory=Lidar)
    name: str = "scan"
    height: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    sweep: float = 0.0
    delay: float = 0.0
    elevations: tuple[float, ...] = (0.0,)
    clock_offset: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.sweep <= 1.0 / self.lidar.rate or self.delay < 0.0:
            raise ConfigError(
                f"simulated scanner {self.name!r}: a sweep must fit between two scans, "
                "and the delay must not be negative"
            )

    @property
    def is_cloud(self) -> bool:
        """Whether it measures 3D point clouds."""
        return len(self.elevations) > 1

    @property
    def is_level(self) -> bool:
        """Whether all beams lie in a level plane while the body is level."""
        return self.elevations == (0.0,) and self.roll == 0.0 and self.pitch == 0.0

    @property
    def time_increment(self) -> float:
        """From beam to beam [s]."""
        return self.sweep / max(self.lidar.num_beams - 1, 1)

    @property
    def geometry(self) -> ScanGeometry:
        """The geometry that a reader reports of its scans."""
        lidar = self.lidar
        return ScanGeometry(
            lidar.angle_min,
            lidar.angle_increment,
            lidar.num_beams,
            lidar.range_min,
            lidar.range_max,
            True,
            lidar.tf_tracking_sensor,
            self.time_increment,
            self.name,
            self.height,
            self.roll,
            self.pitch,
        )

    @property
    def cloud_geometry(self) -> CloudGeometry:
        """The geometry that a reader reports of its clouds."""
        lidar = self.lidar
        return CloudGeometry(
            self.name,
            lidar.tf_tracking_sensor,
            self.height,
            self.roll,
            self.pitch,
            lidar.range_min,
            lidar.range_max,
        )

    def directions(self) -> FloatArray:
        """Return unit vectors of all beams, sensor frame, shape (num_rings * num_beams, 3)."""
        angles = self.geometry.angles
        rings = [
            np.column_stack(
                (
                    math.cos(up) * np.cos(angles),
                    math.cos(up) * np.sin(angles),
                    np.full(len(angles), math.sin(up)),
                )
            )
            for up in self.elevations
        ]
        return np.vstack(rings)

    def beam_times(self) -> FloatArray:
        """Return the times of all beams since the first, shape (num_rings * num_beams,) [s]."""
        return np.tile(np.arange(self.lidar.num_beams) * self.time_increment, len(self.elevations))


def sweep_ranges(walls: FloatArray, bodies: FloatArray, scanner: MountedLidar) -> FloatArray:
    """Return the exact range along each beam of a sweep, to wall, floor or ceiling.

    Parameters
    ----------
    walls : float64, shape (num_walls, 4), upright segments x1, y1, x2, y2 [m], map frame.
    bodies : float64, shape (num_rings * num_beams, 5), the body when each beam is measured, x [m],
        y [m], theta, roll, pitch [rad], map frame.
    scanner : on the body.

    Returns
    -------
    float64, shape (num_rings * num_beams,) [m]; inf where nothing is nearer than the maximum range.
    """
    from cartoloop.kernels.ray_ranges import ray_ranges
    from cartoloop.sensor.sweep_motion import rotation

    lidar = scanner.lidar
    x, y, yaw = lidar.tf_tracking_sensor
    mounting = rotation(scanner.roll, scanner.pitch, yaw)
    attitudes = bodies[:, [3, 4, 2]]
    beams = turned(attitudes, scanner.directions() @ mounting.T)
    origins = turned(attitudes, np.tile((x, y, scanner.height), (len(bodies), 1)))
    origins[:, :2] += bodies[:, :2]
    level = np.maximum(np.hypot(beams[:, 0], beams[:, 1]), 1e-9)
    near = walls_within(walls, origins, lidar.range_max)
    across = np.empty(len(beams))
    rays = np.column_stack((origins[:, :2], beams[:, :2] / level[:, None]))
    ray_ranges(np.ascontiguousarray(near), rays, lidar.range_max, across)
    with np.errstate(divide="ignore"):
        to_floor = np.where(beams[:, 2] < 0.0, (FLOOR - origins[:, 2]) / beams[:, 2], np.inf)
        to_ceiling = np.where(beams[:, 2] > 0.0, (CEILING - origins[:, 2]) / beams[:, 2], np.inf)
    ranges = np.minimum(across / level, np.minimum(to_floor, to_ceiling))
    return np.where(ranges <= lidar.range_max, ranges, np.inf)
