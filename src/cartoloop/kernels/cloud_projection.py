# SPDX-License-Identifier: Apache-2.0
"""Point clouds to the scans that a level scanner in the same place would have measured."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray
from cartoloop.kernels.range_projection import Position
from cartoloop.kernels.sweep_projection import SweepMotion, place_upright


class CloudLimits(NamedTuple):
    """Which points of a cloud are used.

    Attributes
    ----------
    min_range : nearer points are dropped [m].
    no_return_range : points from here on are no measurements [m].
    min_z, max_z : heights of points, level frame of the robot [m].
    """

    min_range: float
    no_return_range: float
    min_z: float
    max_z: float


@kernel
def project_cloud(
    points: FloatArray,
    times: FloatArray,
    rotation: FloatArray,
    origin: Position,
    motion: SweepMotion,
    limits: CloudLimits,
    centre_x: float,
    centre_y: float,
    nearest: FloatArray,
    out_returns: FloatArray,
) -> int:
    """Write the nearest point of each direction into `out_returns`; return how many there are.

    Parameters
    ----------
    points : float64, shape (n, 3), sensor frame [m]; NaN and inf are ignored.
    times : float64, shape (n,), when each was measured, relative to the time of the scan [s]; shape
        (0,) if all were measured then.
    rotation : float64, shape (3, 3), sensor frame to tracking frame.
    origin : position of the sensor.
    motion : of the robot during the sweep.
    limits : which points are used.
    centre_x, centre_y : origin of the directions, level frame of the robot at the time of the scan
        [m].
    nearest : float64, shape (num_directions,), the full turn in equal parts; overwritten.
    out_returns : float64, shape (num_directions, 2), points in the level frame of the robot at the
        time of the scan [m], counter-clockwise from the direction -x on.
    """
    num_directions = nearest.shape[0]
    nearest[:] = np.inf
    for k in range(points.shape[0]):
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        squared = px * px + py * py + pz * pz
        if squared < limits.min_range * limits.min_range:
            continue
        if not squared < limits.no_return_range * limits.no_return_range:
            continue
        if not squared < np.inf or squared == 0.0:
            continue
        x, y, z = place_upright(
            origin.x + rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz,
            origin.y + rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz,
            origin.z + rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz,
            times[k] if times.shape[0] else 0.0,
            motion,
        )
        if z < limits.min_z or z > limits.max_z:
            continue
        dx, dy = x - centre_x, y - centre_y
        share = (math.atan2(dy, dx) + math.pi) / (2.0 * math.pi)
        direction = min(np.int64(np.floor(share * num_directions)), num_directions - 1)
        distance = dx * dx + dy * dy
        if distance < nearest[direction]:
            nearest[direction] = distance
            out_returns[direction, 0] = x
            out_returns[direction, 1] = y
    kept = 0
    for direction in range(num_directions):
        if nearest[direction] < np.inf:
            out_returns[kept, 0] = out_returns[direction, 0]
            out_returns[kept, 1] = out_returns[direction, 1]
            kept += 1
    return kept
