# SPDX-License-Identifier: Apache-2.0
"""A cloud of points in space to what a level scanner in its place would have seen."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.kernels.sweep_projection import place_upright

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@kernel
def project_cloud(
    points: FloatArray,
    times: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    knot_start: float,
    knot_step: float,
    knots: FloatArray,
    limits: FloatArray,
    centre_x: float,
    centre_y: float,
    nearest: FloatArray,
    out_returns: FloatArray,
) -> int:
    """Write the nearest point of each direction into `out_returns`; return how many there are.

    Parameters
    ----------
    points : float64, shape (n, 3), sensor frame [m]; may hold NaN and inf, which are left out.
    times : float64, shape (n,), when each was measured, from the reference time on [s]; shape (0,)
        if all were then.
    rotation, translation : float64, shapes (3, 3), (3,): sensor frame to tracking frame.
    knot_start, knot_step, knots : the motion during the sweep, as `place_upright` takes it.
    limits : float64, shape (4,) [m]: smallest range, range from which on there is no measurement,
        lowest and highest point above the tracking frame.
    centre_x, centre_y : from where directions count, level frame of the robot at the reference
        time [m].
    nearest : float64, shape (num_directions,), the full turn in equal parts; overwritten.
    out_returns : float64, shape (num_directions, 2), points in the level frame of the robot at the
        reference time [m], counter-clockwise from the direction -x on.
    """
    num_directions = nearest.shape[0]
    nearest[:] = np.inf
    for k in range(points.shape[0]):
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        squared = px * px + py * py + pz * pz
        if not (squared >= limits[0] * limits[0] and squared < limits[1] * limits[1]):
            continue
        if not squared < np.inf or squared == 0.0:
            continue
        x, y, z = place_upright(
            translation[0] + rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz,
            translation[1] + rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz,
            translation[2] + rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz,
            times[k] if times.shape[0] else 0.0,
            knot_start,
            knot_step,
            knots,
        )
        if z < limits[2] or z > limits[3]:
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
