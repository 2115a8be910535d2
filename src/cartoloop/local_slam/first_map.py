# SPDX-License-Identifier: Apache-2.0
"""The walls that the first scans see, for matches alone: they hold no robot where it stands.

A submap of few scans holds a robot without odometry. Far from the scanner a wall is a row of dots,
and the dots of the next scan fit where the robot has not moved. And cells between the rays were not
observed, which fits worse than free space: points lie in observed cells where the robot has not
moved. After some scans, from elsewhere, the dots are walls and the rays meet.

Until then, such a robot is matched to walls without gaps, and free space is as good as none. Only
matches are: the submap itself is as ever, since loop closures compare scans with it.
"""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import LocalSlamConfig
from cartoloop.local_slam.outline import Outline, outline_of
from cartoloop.sensor.pose import Pose, compose, transform_points
from cartoloop.sensor.range_filter import RangeData
from cartoloop.submaps.probability_grid import ProbabilityGrid, insert_cells, scan_cells
from cartoloop.submaps.submap import Submap

MAX_GAP_RAD = math.radians(3.0)
"""Returns whose bearings differ by more are not joined [rad]."""

MAX_LENGTH_M = 2.0
"""Returns further apart are not joined [m]: a door may be between them."""

MAX_BEND_M, MIN_COSINE = 0.08, 0.8
"""Two returns lie on one wall if a return next to them is not further from their line [m], and the
line to that one does not turn by an angle of a smaller cosine."""

POINTS_A_PIXEL = 2
"""Points between two returns, for each pixel of their distance."""


class FirstMap:
    """A grid of walls alone, of the first scans of a session.

    Parameters
    ----------
    config : parameters of local SLAM.

    Attributes
    ----------
    submap : with that grid, at the pose of the first submap; None before the first scan, and once
        there are `prediction.num_young_scans`.
    """

    def __init__(self, config: LocalSlamConfig) -> None:
        self._config = config.submaps
        self._num_left = config.prediction.num_young_scans
        self.submap: Submap | None = None

    def insert(self, tf_local_tracking: Pose, data: RangeData, older: Submap) -> None:
        """Insert a scan that was inserted into the submaps, too.

        Parameters
        ----------
        tf_local_tracking : its pose.
        data : its returns, tracking frame.
        older : of the active submaps, which scans are matched to.
        """
        self._num_left -= 1
        if self._num_left < 0 or (self.submap and self.submap.index != older.index):
            self.submap, self._num_left = None, 0
            return
        resolution, origin = self._config.resolution, older.tf_local_submap
        if self.submap is None:
            self.submap = Submap(older.index, origin, ProbabilityGrid(resolution))
        outline = outline_of(data.returns, data.tf_tracking_sensor)
        walls = np.concatenate((outline.points, joints(outline, resolution / POINTS_A_PIXEL)))
        tf_local_sensor = compose(tf_local_tracking, data.tf_tracking_sensor)
        cells = scan_cells(
            tf_local_sensor, transform_points(tf_local_sensor, walls), np.zeros((0, 2)), resolution
        )
        insert_cells(
            self.submap.grid,
            cells._replace(free=cells.free[:0]),
            self._config,
            (round(origin.x / resolution), round(origin.y / resolution)),
        )
        self.submap.num_scans += 1


def joints(outline: Outline, spacing: float) -> FloatArray:
    """Return points on the lines between neighbouring returns of one wall, shape (n, 2) [m].

    Parameters
    ----------
    outline : of a scan.
    spacing : largest distance between the points [m].
    """
    starts = outline.points[:-1]
    steps = outline.points[1:] - starts
    lengths = np.hypot(*steps.T)
    is_near = (np.diff(outline.bearings) < MAX_GAP_RAD) & (lengths > 0.0)
    on_wall = _on_wall(steps / np.maximum(lengths, 1e-9)[:, np.newaxis], lengths, is_near)
    counts = np.ceil(lengths / spacing).astype(np.int64)
    counts[~on_wall | (lengths > MAX_LENGTH_M)] = 1
    rows: IntArray = np.repeat(np.arange(len(counts)), counts - 1)
    firsts = np.cumsum(counts - 1) - (counts - 1)
    shares = (np.arange(len(rows)) - firsts[rows] + 1) / counts[rows]
    points: FloatArray = starts[rows] + shares[:, np.newaxis] * steps[rows]
    return points


def _on_wall(along: FloatArray, lengths: FloatArray, is_near: BoolArray) -> BoolArray:
    """Return which lines between neighbouring returns go on in the line before or after them.

    Parameters
    ----------
    along : shape (n, 2), unit vectors of the lines.
    lengths : shape (n,) [m].
    is_near : shape (n,), whether the returns are neighbours at all.
    """
    cosines = np.sum(along[:-1] * along[1:], axis=1)
    sines = along[:-1, 0] * along[1:, 1] - along[:-1, 1] * along[1:, 0]
    is_straight = is_near[:-1] & is_near[1:] & (cosines > MIN_COSINE)
    bends_before, bends_after = np.abs(sines) * lengths[:-1], np.abs(sines) * lengths[1:]
    on_wall = np.zeros(len(lengths), dtype=np.bool_)
    on_wall[1:] |= is_straight & (bends_before < MAX_BEND_M)
    on_wall[:-1] |= is_straight & (bends_after < MAX_BEND_M)
    return on_wall
