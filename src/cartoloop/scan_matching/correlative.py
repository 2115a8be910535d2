# SPDX-License-Identifier: Apache-2.0
"""Pixel-accurate matching in a small window, for when the prediction is poor."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.config import CorrelativeMatcherConfig
from cartoloop.kernels.correlative import match_correlative
from cartoloop.sensor.pose import FloatArray, Pose, wrap_angle
from cartoloop.submaps.finished_grid import MIN_PROBABILITY
from cartoloop.submaps.probability_grid import ProbabilityGrid

REACH = 10.0
"""Points further away than this do not make the steps of rotation any finer [m]."""


class CorrelativeMatch(NamedTuple):
    """The best pose of the window and the mean probability of the points there, in [0, 1]."""

    tf_submap_scan: Pose
    score: float


class Scratch:
    """Memory that matches, one at a time, work in: new pages would cost more than the search."""

    def __init__(self) -> None:
        self._places = np.empty(0, dtype=np.int32)
        self._cells = np.empty(0, dtype=np.uint8)

    def places(self, size: int) -> NDArray[np.int32]:
        """Return at least so many entries, int32, of any content."""
        if len(self._places) < size:
            self._places = np.empty(size + size // 2, dtype=np.int32)
        return self._places

    def cells(self, size: int) -> NDArray[np.uint8]:
        """Return at least so many entries, uint8, of any content."""
        if len(self._cells) < size:
            self._cells = np.empty(size + size // 2, dtype=np.uint8)
        return self._cells


def rotation_step(points: FloatArray, resolution: float) -> float:
    """Return delta_theta of eq. (7) [rad]: the farthest point in reach moves by a pixel at most."""
    farthest = min(float(np.sqrt((points * points).sum(axis=1).max())), REACH)
    ratio = resolution / max(farthest, resolution)
    return math.acos(1.0 - 0.5 * ratio * ratio)


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
    points : float64, shape (n, 2), scan frame [m]; n > 0.
    tf_submap_scan : the estimate in the window's centre.
    scratch : of the caller, for its matches in turn.
    """
    step = rotation_step(points, grid.resolution)
    half_width = math.ceil(config.linear_search_window / grid.resolution)
    half_num_rotations = math.ceil(math.radians(config.angular_search_window_deg) / step)
    scratch = scratch or Scratch()
    num_rows, num_cols = grid.cells.shape
    margin, num_levels = 2 * (2 * half_width + 1), 1 + (2 * half_width).bit_length()
    pose = np.empty(3)
    score = match_correlative(
        grid.cells,
        MIN_PROBABILITY,
        grid.origin_x,
        grid.origin_y,
        grid.resolution,
        points,
        np.array(tf_submap_scan),
        half_width,
        half_num_rotations,
        step,
        config.translation_delta_cost_weight,
        config.rotation_delta_cost_weight,
        scratch.places(3 * len(points) * (2 * half_num_rotations + 1)),
        scratch.cells(num_levels * (num_rows + margin) * (num_cols + margin)),
        pose,
    )
    return CorrelativeMatch(Pose(float(pose[0]), float(pose[1]), wrap_angle(float(pose[2]))), score)
