# SPDX-License-Identifier: Apache-2.0
"""Ranges of a scanner among straight walls: the simulator's exact ray casting."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray

CORNER_TOLERANCE = 1e-9
"""A beam hits a wall up to this far beyond its ends [share of its length]: walls share corners only
up to rounding, and no beam may pass between them."""


@kernel
def wall_ranges(
    walls: FloatArray,
    poses: FloatArray,
    angle_min: float,
    angle_increment: float,
    range_max: float,
    out_ranges: FloatArray,
) -> None:
    """Write the distance from each pose along each beam to the nearest wall into `out_ranges`.

    Parameters
    ----------
    walls : float64, shape (num_walls, 4), segments x1, y1, x2, y2 [m], world frame.
    poses : float64, shape (num_poses, 3), the sensor's x [m], y [m], theta [rad], world frame.
    angle_min : angle of beam 0 [rad], sensor frame.
    angle_increment : angle from one beam to the next [rad], positive; all beams within one turn.
    range_max : walls beyond are not measured [m].
    out_ranges : float64, shape (num_poses, num_beams) [m]; inf where a beam meets no wall.

    Notes
    -----
    Each wall is intersected only with the beams between the directions of its two ends, so the cost
    is O(num_walls + beams that hit a wall) for a scan. A wall is infinitely thin: a beam exactly
    along it does not hit it.
    """
    num_beams = out_ranges.shape[1]
    cos_beam = np.empty(num_beams)
    sin_beam = np.empty(num_beams)
    for beam_idx in range(num_beams):
        cos_beam[beam_idx] = math.cos(angle_min + beam_idx * angle_increment)
        sin_beam[beam_idx] = math.sin(angle_min + beam_idx * angle_increment)
    for pose_idx in range(poses.shape[0]):
        ranges = out_ranges[pose_idx]
        ranges[:] = np.inf
        x, y = poses[pose_idx, 0], poses[pose_idx, 1]
        cos = math.cos(poses[pose_idx, 2])
        sin = math.sin(poses[pose_idx, 2])
        for wall_idx in range(walls.shape[0]):
            dx, dy = walls[wall_idx, 0] - x, walls[wall_idx, 1] - y
            ax, ay = cos * dx + sin * dy, cos * dy - sin * dx
            dx, dy = walls[wall_idx, 2] - x, walls[wall_idx, 3] - y
            bx, by = cos * dx + sin * dy, cos * dy - sin * dx
            _intersect_wall(
                ax, ay, bx, by, cos_beam, sin_beam, angle_min, angle_increment, range_max, ranges
            )


@kernel
def _intersect_wall(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    cos_beam: FloatArray,
    sin_beam: FloatArray,
    angle_min: float,
    angle_increment: float,
    range_max: float,
    out_ranges: FloatArray,
) -> None:
    """Shorten the `out_ranges` of one scan by the wall from a to b [m, sensor frame]."""
    cross = ax * by - ay * bx
    if cross < 0.0:  # now the wall runs counter-clockwise as seen from the sensor
        ax, ay, bx, by, cross = bx, by, ax, ay, -cross
    sx, sy = bx - ax, by - ay
    length_squared = sx * sx + sy * sy
    if length_squared == 0.0:
        return
    nearest = min(1.0, max(0.0, -(ax * sx + ay * sy) / length_squared))
    nearest_x, nearest_y = ax + nearest * sx, ay + nearest * sy
    if nearest_x * nearest_x + nearest_y * nearest_y > range_max * range_max:
        return

    num_beams = out_ranges.shape[0]
    turn = 2.0 * math.pi
    width = math.atan2(cross, ax * bx + ay * by)
    start = math.atan2(ay, ax) - angle_min
    start -= turn * math.floor(start / turn)
    # A wall across the direction of beam 0 meets the last beams of one turn and the first of the
    # next. The beams at its ends are included because the angles are rounded.
    for lap in range(2):
        first = math.floor((start - lap * turn) / angle_increment)
        last = math.ceil((start - lap * turn + width) / angle_increment)
        for beam_idx in range(max(0, int(first)), min(num_beams - 1, int(last)) + 1):
            cos, sin = cos_beam[beam_idx], sin_beam[beam_idx]
            approach = cos * sy - sin * sx
            if approach <= 0.0:
                continue
            along = (sin * ax - cos * ay) / approach
            if along < -CORNER_TOLERANCE or along > 1.0 + CORNER_TOLERANCE:
                continue
            distance = cross / approach
            if distance <= range_max and distance < out_ranges[beam_idx]:
                out_ranges[beam_idx] = distance
