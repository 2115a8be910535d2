# SPDX-License-Identifier: Apache-2.0
"""All cells that an inserted scan says something of, its walls between and behind returns too."""

from __future__ import annotations

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import CellArray, FloatArray
from cartoloop.kernels.behind_walls import points_behind_walls
from cartoloop.kernels.pixel_rows import RunArray
from cartoloop.kernels.ray_casting import scan_cells
from cartoloop.kernels.wall_joints import wall_joints


@kernel
def cells_with_walls(
    origin_x: float,
    origin_y: float,
    returns: FloatArray,
    misses: FloatArray,
    resolution: float,
    max_return_gap: float,
    joint_straightness: float,
    wall_reach: float,
    wall_straightness: float,
    uncertain_length: float,
    uncertain_share: float,
) -> tuple[CellArray, RunArray, CellArray, int, int, int, int]:
    """Return the cells as :func:`scan_cells` does, with points on and behind straight walls.

    In one call, since it is made for each inserted scan.

    Parameters
    ----------
    origin_x, origin_y, returns, misses, resolution : as :func:`scan_cells` takes them, the returns
        in the order of the beams.
    max_return_gap, joint_straightness : as :func:`wall_joints` takes them; no joints where the
        first is 0.
    wall_reach, wall_straightness : as :func:`points_behind_walls` takes them; a pixel behind the
        walls. None where the first is 0.
    uncertain_length, uncertain_share : as :func:`scan_cells` takes them.
    """
    behind = np.empty((0, 2))
    if wall_reach > 0.0:
        behind = points_behind_walls(
            origin_x, origin_y, returns, wall_reach, wall_straightness, resolution
        )
    ends = returns
    if max_return_gap > 0.0:
        joints = wall_joints(returns, max_return_gap, joint_straightness, resolution)
        count, total = returns.shape[0], returns.shape[0] + joints.shape[0]
        ends = np.empty((total, 2))
        for k in range(total):
            for axis in range(2):
                ends[k, axis] = returns[k, axis] if k < count else joints[k - count, axis]
    return scan_cells(
        origin_x, origin_y, ends, misses, behind, resolution, uncertain_length, uncertain_share
    )
