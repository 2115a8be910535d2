# SPDX-License-Identifier: Apache-2.0
"""Monte Carlo localisation with a likelihood field: the method of AMCL, written plainly.

S. Thrun, W. Burgard, D. Fox, Probabilistic Robotics, 2005: tables 5.6 (motion), 6.3 (likelihood
field), 8.2 and 8.3 (augmented, with KLD sampling). Parameters are the defaults that Nav2's AMCL
publishes: 60 beams, z_hit 0.5, z_rand 0.5, sigma_hit 0.2 m, distances up to 2 m, alphas 0.2, 500 to
2,000 particles, updates after 0.25 m or 0.2 rad; from nowhere it starts with more particles.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import distance_transform_edt

from cartoloop.arrays import FloatArray
from cartoloop.localisation.known_map import KnownMap
from cartoloop.sensor.pose import Pose, relative, wrap_angles

MAX_BEAMS = 60
Z_HIT, Z_RAND, SIGMA_HIT_M, MAX_DISTANCE_M = 0.5, 0.5, 0.2, 2.0
ALPHA = 0.2
MIN_STEP_M, MIN_TURN_RAD = 0.25, 0.2
MIN_PARTICLES, MAX_PARTICLES = 500, 2000
RESAMPLE_BELOW = 0.5
LOCATED_SIGMA_M = 0.5
"""It says where it is once the particles are closer together than this [m]; AMCL itself never says
that it does not know."""


class ParticleFilter:
    """Particles in a map, from nowhere.

    Parameters
    ----------
    known : the map.
    num_particles : at the beginning, everywhere on floor.
    seed : of the noise.
    """

    def __init__(self, known: KnownMap, num_particles: int, seed: int) -> None:
        grid = known.grid
        cells = grid.cells
        self._grid, self._rng = grid, np.random.default_rng(seed)
        distance = distance_transform_edt(cells < 150) * grid.resolution
        near = np.minimum(distance, MAX_DISTANCE_M)
        self._field = Z_HIT * np.exp(-0.5 * (near / SIGMA_HIT_M) ** 2) + Z_RAND / 30.0
        self._outside = Z_HIT * math.exp(-0.5 * (MAX_DISTANCE_M / SIGMA_HIT_M) ** 2) + Z_RAND / 30.0
        rows, cols = np.nonzero((cells > 0) & (cells < 80))
        chosen = self._rng.integers(0, len(rows), num_particles)
        self.particles: FloatArray = np.column_stack(
            (
                grid.origin_x + cols[chosen] * grid.resolution,
                grid.origin_y + rows[chosen] * grid.resolution,
                self._rng.uniform(-np.pi, np.pi, num_particles),
            )
        )
        self._weights = np.full(num_particles, 1.0 / num_particles)
        self._last: Pose | None = None

    def add(self, tf_odom_tracking: Pose, points: FloatArray) -> None:
        """Move by odometry, and weigh by a scan, if the robot has moved enough."""
        if self._last is None:
            self._last = tf_odom_tracking
            self._weigh(points)
            return
        step = relative(self._last, tf_odom_tracking)
        if math.hypot(step.x, step.y) < MIN_STEP_M and abs(step.theta) < MIN_TURN_RAD:
            return
        self._last = tf_odom_tracking
        self._move(step)
        self._weigh(points)

    @property
    def estimate(self) -> tuple[Pose, float]:
        """The mean of the particles, and their spread [m]; grid frame."""
        x, y = (self._weights @ self.particles[:, :2]).tolist()
        theta = math.atan2(
            float(self._weights @ np.sin(self.particles[:, 2])),
            float(self._weights @ np.cos(self.particles[:, 2])),
        )
        squares = ((self.particles[:, :2] - (x, y)) ** 2).sum(axis=1)
        return Pose(x, y, theta), math.sqrt(float(self._weights @ squares))

    def _move(self, step: Pose) -> None:
        length = math.hypot(step.x, step.y)
        first = math.atan2(step.y, step.x) if length > 0.01 else 0.0
        second = float(wrap_angles(np.array(step.theta - first)))
        turns = [min(abs(turn), math.pi - abs(turn)) for turn in (first, second)]
        count = len(self.particles)
        noise = self._rng.standard_normal((3, count))
        first_turn = first + noise[0] * math.sqrt(ALPHA * turns[0] ** 2 + ALPHA * length**2)
        moved = length + noise[1] * math.sqrt(
            ALPHA * length**2 + ALPHA * (turns[0] ** 2 + turns[1] ** 2)
        )
        second_turn = second + noise[2] * math.sqrt(ALPHA * turns[1] ** 2 + ALPHA * length**2)
        self.particles[:, 0] += moved * np.cos(self.particles[:, 2] + first_turn)
        self.particles[:, 1] += moved * np.sin(self.particles[:, 2] + first_turn)
        self.particles[:, 2] = wrap_angles(self.particles[:, 2] + first_turn + second_turn)

    def _weigh(self, points: FloatArray) -> None:
        used = points[:: max(len(points) // MAX_BEAMS, 1)]
        cos, sin = np.cos(self.particles[:, 2, None]), np.sin(self.particles[:, 2, None])
        x = self.particles[:, 0, None] + cos * used[:, 0] - sin * used[:, 1]
        y = self.particles[:, 1, None] + sin * used[:, 0] + cos * used[:, 1]
        grid = self._grid
        cols = np.floor((x - grid.origin_x) / grid.resolution + 0.5).astype(np.int64)
        rows = np.floor((y - grid.origin_y) / grid.resolution + 0.5).astype(np.int64)
        num_rows, num_cols = grid.shape
        inside = (cols >= 0) & (cols < num_cols) & (rows >= 0) & (rows < num_rows)
        likelihood = np.full(x.shape, self._outside)
        likelihood[inside] = self._field[rows[inside], cols[inside]]
        self._weights *= 1.0 + (likelihood**3).sum(axis=1)  # as AMCL combines beams
        self._weights /= self._weights.sum()
        if 1.0 / float((self._weights**2).sum()) < RESAMPLE_BELOW * len(self._weights):
            self._resample()

    def _resample(self) -> None:
        """Draw particles by low variance, as many as KLD sampling asks for."""
        bins = np.floor(self.particles / (0.5, 0.5, math.radians(10.0))).astype(np.int64)
        cumulated = np.cumsum(self._weights)

        def draw(count: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
            at = (self._rng.random() + np.arange(count)) / count
            return np.minimum(np.searchsorted(cumulated, at), len(cumulated) - 1)

        occupied = len(np.unique(bins[draw(len(self.particles))], axis=0))
        k = max(occupied, 2)
        part = 2.0 / (9.0 * (k - 1))
        wanted = (k - 1) / (2.0 * 0.05) * (1.0 - part + math.sqrt(part) * 2.326) ** 3
        limit = max(MAX_PARTICLES, MIN_PARTICLES) if wanted <= MAX_PARTICLES else len(bins)
        count = int(min(max(wanted, MIN_PARTICLES), limit))
        self.particles = self.particles[draw(count)].copy()
        self._weights = np.full(count, 1.0 / count)
