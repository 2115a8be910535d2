# SPDX-License-Identifier: Apache-2.0
"""How near places are to walls, for tests of simulated worlds."""

import numpy as np

from cartoloop.simulation import drive
from cartoloop.simulation.lidar import walls_within


def clearance(walls, points):
    """Distance from each point to the nearest wall, as far as it is below a metre."""
    return np.concatenate(
        [
            _clearance_nearby(walls_within(walls, some, 1.0), some)
            for some in np.array_split(points, len(points) // 100 + 1)
        ]
    )


def _clearance_nearby(walls, points):
    begin, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    offset = points[:, None] - begin
    share = np.clip((offset * along).sum(2) / (along**2).sum(1), 0.0, 1.0)
    return np.linalg.norm(offset - share[..., None] * along, axis=2).min(1, initial=1.0)


def clearance_of_route(world):
    """Distance from the way to the nearest wall, at places nearer to each other than that."""
    motion = drive(world.route, *world.pace)
    points = motion.poses_at(np.arange(0.0, motion.duration, 0.2))[:, :2]
    return clearance(world.walls, points).min()
