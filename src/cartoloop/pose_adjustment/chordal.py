# SPDX-License-Identifier: Apache-2.0
"""A start from the measurements alone, for problems whose given poses are too far off.

Chordal relaxation (Carlone et al., "Initialization techniques for 3D SLAM", 2015). In the plane it
is two linear least squares problems: headings, as vectors r = (cos theta, sin theta) that minimise
the errors of r_b = R(theta_ab) r_a, without the constraint |r| = 1; then, for these headings,
positions t that minimise the errors of t_b = t_a + R_a t_ab. Neither depends on a start, so there
is no local minimum.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.kernels import sparse_cholesky
from cartoloop.kernels.pose_adjustment.layout import GroupLosses
from cartoloop.pose_adjustment.linearise import cost_at
from cartoloop.pose_adjustment.plan import Plan
from cartoloop.pose_adjustment.problem import Measurements, Problem, held_vertices
from cartoloop.sensor.pose import wrap_angles

FAR_OFF_RAD = 0.5
"""A rotation residual that no linearisation predicts well."""
FAR_OFF_SHARE = 0.01
"""Share of constraints so far off from which on the start is not trusted. A few alone are false
loop closures."""
_LEAST_WEIGHT = 1e-9
"""Least weight of a measurement, as a share of the largest: it keeps the system regular where only
measurements without information connect vertices."""


def is_far_off(measured: Measurements, poses: FloatArray) -> bool:
    """Return whether so much disagrees in heading that steps from these poses may lead astray."""
    rotation = measured.residuals(poses).rotation
    return bool(np.count_nonzero(rotation > FAR_OFF_RAD) > FAR_OFF_SHARE * rotation.size)


def chordal_start(problem: Problem, measured: Measurements | None = None) -> FloatArray:
    """Return poses of all vertices from the measurements alone, shape (num_vertices, 3).

    Fixed vertices keep their poses, and so does the first vertex of each connected part without a
    fixed one or a control point. There is no robust loss: many false loop closures spoil it.

    Parameters
    ----------
    measured : of the problem; None to gather them here.
    """
    poses = problem.poses()
    found = measured or Measurements.of(problem)
    if found.groups.size == 0:
        return poses
    held = held_vertices(problem, found.vertex_a, found.vertex_b)
    system = _System.of(held, found.vertex_a, found.vertex_b)
    turn = found.tf_a_b[:, 2]
    headings = np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
    nothing = np.zeros((turn.size, 2))
    headings = system.solve(found.informations[:, 2, 2], turn, nothing, headings)
    angles = np.arctan2(headings[:, 1], headings[:, 0])
    cos, sin = np.cos(angles[found.vertex_a]), np.sin(angles[found.vertex_a])
    x, y = found.tf_a_b[:, 0], found.tf_a_b[:, 1]
    moves = np.column_stack((cos * x - sin * y, sin * x + cos * y))
    weights = 0.5 * (found.informations[:, 0, 0] + found.informations[:, 1, 1])
    poses[:, :2] = system.solve(weights, np.zeros(turn.size), moves, poses[:, :2])
    poses[~held, 2] = wrap_angles(angles[~held])
    return poses


def better_start(plan: Plan, measured: Measurements, losses: GroupLosses) -> FloatArray:
    """Return poses to begin with: those of the problem, or chordal ones where they cost less.

    Levenberg-Marquardt finds the nearest minimum. From a chain of odometry that has turned by a
    radian that is a bad one, and the way there is long.
    """
    poses = plan.problem.poses()
    if not is_far_off(measured, poses):
        return poses
    chordal = chordal_start(plan.problem, measured)
    return min(poses, chordal, key=lambda start: cost_at(plan, start, losses))


class _System(NamedTuple):
    """Linear least squares of vectors at the vertices; held ones are known.

    Attributes
    ----------
    held, rows : whether a vertex is held; its row in the system, num_free if so.
    vertex_a, vertex_b : ends of each measurement.
    blocks : block of the system between them; 0 of none: then it is not added.
    num_blocks : blocks above the diagonal.
    plan : of the factorization.
    """

    held: BoolArray
    rows: IntArray
    vertex_a: IntArray
    vertex_b: IntArray
    blocks: IntArray
    num_blocks: int
    plan: sparse_cholesky.Plan

    @classmethod
    def of(cls, held: BoolArray, vertex_a: IntArray, vertex_b: IntArray) -> _System:
        count = int(np.count_nonzero(~held))
        rows = np.full(held.size, count, dtype=np.int64)
        rows[~held] = np.arange(count)
        low = np.minimum(rows[vertex_a], rows[vertex_b])
        high = np.maximum(rows[vertex_a], rows[vertex_b])
        is_between = high < count
        keys, place = np.unique(
            low[is_between] * (count + 1) + high[is_between], return_inverse=True
        )
        blocks = np.full(low.size, -1, dtype=np.int64)
        blocks[is_between] = place.ravel()
        begin = np.searchsorted(keys, np.arange(count + 1) * (count + 1))
        plan = sparse_cholesky.plan(begin.astype(np.int64), keys % (count + 1))
        return cls(held, rows, vertex_a, vertex_b, blocks, keys.size, plan)

    def solve(
        self, weights: FloatArray, turn: FloatArray, moves: FloatArray, values: FloatArray
    ) -> FloatArray:
        """Return x that minimises sum w |x_b - R(turn) x_a - move|^2.

        Parameters
        ----------
        weights, turn : shape (n,), of each measurement; turn in rad.
        moves : shape (n, 2).
        values : shape (num_vertices, 2), those of held vertices are kept.
        """
        rows_a, rows_b = self.rows[self.vertex_a], self.rows[self.vertex_b]
        count = self.plan.order.size
        if count == 0:
            return values
        w = np.maximum(weights, _LEAST_WEIGHT * weights.max(initial=0.0))
        cos, sin = np.cos(turn), np.sin(turn)
        # blocks of 3 x 3: the third number of a vertex is zero
        blocks = np.zeros((count + 1 + self.num_blocks, 9))
        diagonal = _sums(rows_a, w, count + 1) + _sums(rows_b, w, count + 1)
        blocks[: count + 1, 0] = blocks[: count + 1, 4] = diagonal
        blocks[:count, 8] = 1.0
        between = self.blocks >= 0
        own, from_a = self.blocks[between], (rows_a < rows_b)[between]
        along, across = (w * cos)[between], np.where(from_a, 1.0, -1.0) * (w * sin)[between]
        # H_ab = -w R^T, H_ba = -w R
        blocks[count + 1 :, 0] = blocks[count + 1 :, 4] = -_sums(own, along, self.num_blocks)
        blocks[count + 1 :, 1] = -_sums(own, across, self.num_blocks)
        blocks[count + 1 :, 3] = _sums(own, across, self.num_blocks)
        known = np.where(self.held[:, np.newaxis], values, 0.0)
        at_a, at_b = known[self.vertex_a], known[self.vertex_b]
        error_x = w * (at_b[:, 0] - cos * at_a[:, 0] + sin * at_a[:, 1] - moves[:, 0])
        error_y = w * (at_b[:, 1] - sin * at_a[:, 0] - cos * at_a[:, 1] - moves[:, 1])
        gradient = np.zeros((count + 1, 3))
        gradient[:, 0] = _sums(rows_b, error_x, count + 1) - _sums(
            rows_a, cos * error_x + sin * error_y, count + 1
        )
        gradient[:, 1] = _sums(rows_b, error_y, count + 1) - _sums(
            rows_a, cos * error_y - sin * error_x, count + 1
        )
        steps = np.zeros((count + 1, 3))
        buffers = sparse_cholesky.workspace(self.plan)
        damping = 0.0
        while not sparse_cholesky.solve(self.plan, blocks, gradient, damping, buffers, steps)[1]:
            damping = max(10.0 * damping, 1e-9)
        result = values.copy()
        result[~self.held] = steps[:count, :2]
        return result


def _sums(places: IntArray, values: FloatArray, size: int) -> FloatArray:
    return np.bincount(places, weights=values, minlength=size).astype(np.float64, copy=False)
