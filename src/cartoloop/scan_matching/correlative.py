# SPDX-License-Identifier: Apache-2.0
"""Pixel-accurate matching in a small window, for when the prediction is poor."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import ByteArray, CellArray, FloatArray
from cartoloop.config import CorrelativeMatcherConfig
from cartoloop.kernels.correlative import match_correlative
from cartoloop.kernels.search_window import rotation_step
from cartoloop.sensor.pose import Pose, wrap_angle
from cartoloop.submaps.finished_grid import MIN_PROBABILITY
from cartoloop.submaps.probability_grid import ProbabilityGrid


class CorrelativeMatch(NamedTuple):
    """The best pose of the window, and the mean probability at its points in [0, 1]."""

    tf_submap_scan: Pose
    score: float


class Scratch:
    """Memory kept between matches: fresh pages would cost more than the search."""

    def __init__(self) -> None:
        self._places = np.empty(0, dtype=np.int32)
        self._cells = np.empty(0, dtype=np.uint8)

    def places(self, size: int) -> CellArray:
        """Return an int32 array of at least this size, of any content."""
        if len(self._places) < size:
            self._places = np.empty(size + size // 2, dtype=np.int32)
        return self._places

    def cells(self, size: int) -> ByteArray:
        """Return a uint8 array of at least this size, of any content."""
        if len(self._cells) < size:
            self._cells = np.empty(size + size // 2, dtype=np.uint8)
        return self._cells


def step_of_points(points: FloatArray, resolution: float, max_range: float) -> float:
    """Return delta_theta of eq. (7) [rad], where points beyond a range do not count.

    Points within a cell of the origin count as a cell away, so that the step is at most 60 degrees.

    Parameters
    ----------
    points : float64, shape (n, 2), tracking frame [m]; n > 0.
    resolution, max_range : [m].
    """
    farthest = float(np.sqrt((points * points).sum(axis=1).max()))
    return rotation_step(min(farthest, max_range), resolution, resolution)


def match(
    grid: ProbabilityGrid,
    points: FloatArray,
    tf_submap_scan: Pose,
    config: CorrelativeMatcherConfig,
    scratch: Scratch | None = None,
) -> CorrelativeMatch:
    """Return the best pose in the window around an estimate.

    Parameters
    ----------
    points : float64, shape (n, 2), tracking frame [m]; n > 0.
    tf_submap_scan : the estimate in the window's centre.
    scratch : memory that the caller keeps for its next match; not shared between threads.
    """
    resolution = grid.resolution
    step = step_of_points(points, resolution, config.max_rotation_step_range)
    half_width = math.ceil(config.linear_search_window / resolution)
    half_num_rotations = math.ceil(math.radians(config.angular_search_window_deg) / step)
    scratch = scratch or Scratch()
    num_rows, num_cols = grid.cells.shape
    margin, num_levels = 2 * (2 * half_width + 1), 1 + (2 * half_width).bit_length()
    pose = np.empty(3)
    score = match_correlative(
        (grid.cells, grid.origin_x, grid.origin_y, resolution, 0.0),
        MIN_PROBABILITY,
        points,
        np.array(tf_submap_scan),
        (
            half_width,
            half_num_rotations,
            step,
            config.translation_delta_cost_weight,
            config.rotation_delta_cost_weight,
        ),
        (
            scratch.places(3 * len(points) * (2 * half_num_rotations + 1)),
            scratch.cells(num_levels * (num_rows + margin) * (num_cols + margin)),
        ),
        pose,
    )
    return CorrelativeMatch(Pose(float(pose[0]), float(pose[1]), wrap_angle(float(pose[2]))), score)
