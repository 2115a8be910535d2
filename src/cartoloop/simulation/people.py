# SPDX-License-Identifier: Apache-2.0
"""People who walk near a simulated robot: ahead of it, behind it, past it."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.sensor.pose import compose_all
from cartoloop.simulation.lidar import Lidar
from cartoloop.simulation.motion import Motion

BODY_RADIUS = 0.2
"""Radius of a person at the height of the scanner [m]."""

FARTHEST = (6.0, 14.0)
"""How far ahead of the robot, and as far behind it, a person walks before turning round [m]."""

SPEEDS = (0.4, 1.5)
"""Speeds of people relative to the robot, along its path [m/s]."""

ASIDE = (0.45, 0.65)
"""How far beside the robot's path people walk [m]: they pass it without touching it."""


class People:
    """People who walk to and fro along the robot's path, relative to the robot.

    Parameters
    ----------
    motion : of the robot.
    count : number of people.
    rng : the source of their speeds and places.
    """

    def __init__(self, motion: Motion, count: int, rng: np.random.Generator) -> None:
        travelled = motion.travelled_at(motion.times)
        moved = np.concatenate(([True], np.diff(travelled) > 0.0))
        self._motion = motion
        self._path, self._path_poses = travelled[moved], motion.poses[moved]
        self._farthest = rng.uniform(*FARTHEST, count)
        self._periods = 4.0 * self._farthest / rng.uniform(*SPEEDS, count)
        self._phases = rng.uniform(0.0, 1.0, count)
        self._aside = rng.uniform(*ASIDE, count) * rng.choice((-1.0, 1.0), count)

    def places_at(self, times: FloatArray) -> FloatArray:
        """Return where everybody is at `times` [s], shape (n, count, 2) [m], map frame."""
        robot = self._motion.travelled_at(times)
        turns = times[:, None] / self._periods + self._phases
        to_and_fro = 4.0 * np.abs(turns - np.floor(turns) - 0.5) - 1.0
        along = robot[:, None] + to_and_fro * self._farthest
        x, y, theta = (np.interp(along, self._path, self._path_poses[:, axis]) for axis in range(3))
        return np.stack((x - self._aside * np.sin(theta), y + self._aside * np.cos(theta)), axis=2)

    def ranges(self, robot_poses: FloatArray, times: FloatArray, lidar: Lidar) -> FloatArray:
        """Return the distance to the nearest person along each beam, inf where there is none.

        Parameters
        ----------
        robot_poses : float64, shape (n, 3), x [m], y [m], theta [rad], map frame.
        times : float64, shape (n,), when the scans are taken [s].
        lidar : the scanner.

        Returns
        -------
        float64, shape (n, num_beams) [m].
        """
        sensors = compose_all(robot_poses, np.array(lidar.tf_tracking_sensor))
        angles = sensors[:, 2:] + lidar.geometry.angles
        cos, sin = np.cos(angles), np.sin(angles)
        nearest = np.full(angles.shape, np.inf)
        for person in np.moveaxis(self.places_at(times), 1, 0):
            away = person - sensors[:, :2]
            squared = (away**2).sum(axis=1)
            near = squared < (lidar.range_max + BODY_RADIUS) ** 2
            ahead = cos[near] * away[near, :1] + sin[near] * away[near, 1:]
            depth = BODY_RADIUS**2 - squared[near, None] + ahead**2
            with np.errstate(invalid="ignore"):
                front = np.maximum(ahead - np.sqrt(depth), 0.0)
            hit = (depth >= 0.0) & (ahead > 0.0) & (front <= lidar.range_max)
            nearest[near] = np.minimum(nearest[near], np.where(hit, front, np.inf))
        return nearest
