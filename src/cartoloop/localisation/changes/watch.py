# SPDX-License-Identifier: Apache-2.0
"""Scans of a robot that is located, compared with the map, cell by cell.

A cell differs if it is a wall of the map and beams pass through it, or floor of the map and returns
lie on it. Both are counted in scans that show something new: the robot has moved since
the last one. A return is of a wall if it is as near to it as the pose may be wrong.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.kernels.map_changes import LookGrids, LookLimits, note_look
from cartoloop.localisation.answer import Answer
from cartoloop.localisation.changes.areas import Changes, changes_of
from cartoloop.localisation.doubt import QUICK
from cartoloop.localisation.known_map import KnownMap
from cartoloop.quality.pairs import FLOOR, WALL
from cartoloop.sensor.pose import Pose, compose, relative, transform_points, wrap_angle
from cartoloop.submaps.finished_grid import mean_value

STEP_M, TURN_RAD, PERIOD_S = 0.2, math.radians(10.0), 1.0
"""A scan is compared if the robot has moved by this path, turned by this angle or waited for this
time since the last one [m], [rad], [s]."""

REACH_CELLS = 1.5
"""Tolerance where the pose is exact [cells]: returns and walls are rounded to cells."""

NUM_SIGMAS = 2.0
"""Standard deviations of the pose that are tolerated."""

MAX_TOLERANCE_M = 0.3
"""Beams whose ends may be displaced by more than this are not used [m]."""

CLEARANCE_CELLS = 2.0
"""A wall is passed through if the beam goes on behind it for this much more than the tolerance
[cells]: walls are two to three cells thick."""

MAX_BALANCE = 10
"""Scans that it takes at most to change the mind about a cell: one way, and as many back."""

PROVED_PATH_M, PROVED_S = 3.0, 5.0
"""A scan counts when the robot is still located after this path and time [m], [s]: by then it is
noticed if a place was wrong."""

MAX_WAITING = 64
"""Scans that wait for that; of more than these the oldest counts."""


class _Look(NamedTuple):
    """A scan that waits until its pose is proved."""

    stamp: float
    travelled: float
    limits: LookLimits
    start: tuple[float, float]
    ends: FloatArray


def no_looks(shape: tuple[int, ...]) -> LookGrids:
    """Return what no looks come to, for a map of a shape."""
    return LookGrids(
        np.zeros(shape, np.int32), np.zeros(shape, np.uint16), np.zeros(shape, np.uint16),
        np.zeros(shape, np.uint16), np.zeros(shape, np.int8), np.zeros(shape), np.zeros(shape),
    )  # fmt: skip


class ChangeWatch:
    """Compares scans with a map; its memory does not grow.

    Parameters
    ----------
    known : the map.

    Attributes
    ----------
    num_scans : number of scans that were compared.
    """

    def __init__(self, known: KnownMap) -> None:
        self._known = known
        self._grids = no_looks(known.cell_grid.cells.shape)
        self.num_scans = 0
        self._waiting: deque[_Look] = deque()
        self._last: dict[Pose, tuple[float, Pose]] = {}  # by the pose of the scanner
        self._last_local: Pose | None = None
        self._travelled = 0.0
        self._first_stamp = self._last_stamp = math.nan

    def add(self, answer: Answer, points: FloatArray, beam_origin: Pose) -> None:
        """Compare a scan, if the robot is located and the scan shows something new.

        Parameters
        ----------
        answer : to the scan.
        points : float64, shape (n, 2), its returns [m], tracking frame.
        beam_origin : pose of the scanner on the robot.
        """
        pose = answer.tf_map_tracking
        if pose is None or answer.covariance is None:
            self._waiting.clear()
            self._last.clear()
            self._last_local = None
            return
        if self._last_local is not None:
            self._travelled += math.dist(self._last_local[:2], answer.tf_local_tracking[:2])
        self._last_local = answer.tf_local_tracking
        self._count_proved(answer.stamp)
        if len(points) == 0 or not self._is_new(answer.stamp, pose, beam_origin):
            return
        if not answer.agreement >= QUICK.expected * self._known.usual.agreement:
            return
        self._last[beam_origin] = answer.stamp, pose
        self._waiting.append(self._look(answer, pose, points, beam_origin))

    def changes(self) -> Changes:
        """Return what has changed by all scans until now."""
        while self._waiting:
            self._count(self._waiting.popleft())
        return changes_of(
            self._known, self._grids, self.num_scans, (self._first_stamp, self._last_stamp)
        )

    def _is_new(self, stamp: float, pose: Pose, beam_origin: Pose) -> bool:
        """Return whether the robot has moved since the last scan of the same scanner."""
        if beam_origin not in self._last:
            return True
        last_stamp, last = self._last[beam_origin]
        step = relative(last, pose)
        return (
            math.hypot(step.x, step.y) >= STEP_M
            or abs(wrap_angle(step.theta)) >= TURN_RAD
            or stamp - last_stamp >= PERIOD_S
        )

    def _look(self, answer: Answer, pose: Pose, points: FloatArray, beam_origin: Pose) -> _Look:
        known, resolution = self._known, self._known.grid.resolution
        tf_grid_tracking = known.to_grid(pose)
        origin = np.array((known.grid.origin_x, known.grid.origin_y))
        ends = (transform_points(tf_grid_tracking, points) - origin) / resolution
        start = compose(tf_grid_tracking, beam_origin)
        col, row = ((np.array(start[:2]) - origin) / resolution).tolist()
        return _Look(
            answer.stamp, self._travelled, self._limits(answer), (col, row),
            np.ascontiguousarray(ends),
        )  # fmt: skip

    def _limits(self, answer: Answer) -> LookLimits:
        """Return the limits of a scan, by the covariance of its pose."""
        assert answer.covariance is not None
        resolution = self._known.grid.resolution
        sigma = math.sqrt(max(float(np.linalg.eigvalsh(answer.covariance[:2, :2])[1]), 0.0))
        return LookLimits(
            math.floor(mean_value(WALL)),
            math.floor(mean_value(FLOOR)),
            REACH_CELLS,
            NUM_SIGMAS * sigma / resolution,
            NUM_SIGMAS * math.sqrt(max(float(answer.covariance[2, 2]), 0.0)),
            MAX_TOLERANCE_M / resolution,
            CLEARANCE_CELLS,
            MAX_BALANCE,
        )

    def _count_proved(self, stamp: float) -> None:
        """Count the scans since which the robot has gone on without getting lost."""
        while self._waiting:
            oldest = self._waiting[0]
            is_proved = (
                self._travelled - oldest.travelled >= PROVED_PATH_M
                and stamp - oldest.stamp >= PROVED_S
            )
            if not is_proved and len(self._waiting) < MAX_WAITING:
                return
            self._count(self._waiting.popleft())

    def _count(self, look: _Look) -> None:
        self.num_scans += 1
        if self.num_scans == 1:
            self._first_stamp = look.stamp
        self._last_stamp = look.stamp
        note_look(
            self._known.cell_grid.cells, look.limits, *look.start, look.ends, self.num_scans,
            look.stamp, self._grids,
        )  # fmt: skip
