# SPDX-License-Identifier: Apache-2.0
"""All kernels run once before the robot starts, so that it waits for no compiler and no disk."""

from __future__ import annotations

import gc
import math
import sys

import numpy as np

from cartoloop.compile_ahead import square_room_ranges
from cartoloop.config import Config, ConstraintSearchConfig, GlobalSlamConfig
from cartoloop.mapper import Mapper
from cartoloop.sensor.events import LaserScan, Odometry, ScanGeometry
from cartoloop.sensor.pose import Pose

SWITCH_S = 0.0002
"""Switch interval of Python's threads [s]: the longest wait of a pose for another thread."""

_ROOM = 4.0
"""Half the side of the simulated room [m]."""

_SCANS = 60
"""Scans of the drive: enough for loop closures and an adjustment."""

_WALLS, _ASIDE, _CORRIDOR_SCANS = 1.5, 0.5, 8
"""Distance of the corridor's walls and of the last scan from its middle [m]; number of scans."""


def get_ready() -> None:
    """Prepare this process for live mapping: kernels are compiled, and threads switch quickly."""
    warm_up()
    gc.collect()
    gc.freeze()
    gc.disable()  # a full collection takes longer than mapping a scan: see tidy
    sys.setswitchinterval(SWITCH_S)


def tidy() -> None:
    """Collect the recent garbage; to be called every few seconds."""
    if not gc.isenabled():
        gc.collect(1)
        gc.freeze()  # the rest stays, and does not have to be examined again


def warm_up() -> None:
    """Map a small room twice, with loop closures, then a corridor; discard the maps."""
    config = Config()
    local_slam = config.local_slam.model_copy(
        update={"submaps": config.local_slam.submaps.model_copy(update={"num_range_data": 6})}
    )
    search = ConstraintSearchConfig(well_constrained_length=0.0, every_nth_node=1)
    global_slam = GlobalSlamConfig(
        optimize_every_n_nodes=12, constraint_search=search, num_threads=1
    )
    config = config.model_copy(update={"local_slam": local_slam, "global_slam": global_slam})
    _map_room(Mapper(config))
    _map_corridor(Mapper(config))


def _map_room(mapper: Mapper) -> None:
    """Drive through a room with odometry: turning at first, then straight on."""
    geometry = ScanGeometry(-math.pi, math.radians(2.0), 180, 0.1, 30.0)
    for k in range(_SCANS):
        pose = Pose(0.05 * k - 1.5, 0.2 * math.sin(0.3 * k), 0.05 * min(k, _SCANS // 2))
        ranges = square_room_ranges(_ROOM, pose, geometry.angles)
        mapper.add(Odometry(0.1 * k, 0.1 * k, pose))
        mapper.add(LaserScan(0.1 * k, 0.1 * k, ranges, geometry))
    mapper.finish()


def _map_corridor(mapper: Mapper) -> None:
    """Map bare walls without odometry by a scanner that sweeps, and is moved aside in the end.

    So that scans are deskewed and compared with each other, and one is searched for.
    """
    geometry = ScanGeometry(-math.pi, math.radians(2.0), 180, 0.1, 30.0, time_increment=1e-4)
    across = np.sin(geometry.angles)
    for k in range(_CORRIDOR_SCANS):
        aside = 0.0 if k < _CORRIDOR_SCANS - 1 else _ASIDE
        with np.errstate(divide="ignore"):
            ranges = np.where(across > 0.0, _WALLS - aside, _WALLS + aside) / np.abs(across)
        mapper.add(LaserScan(0.1 * k, 0.1 * k, ranges, geometry))
    mapper.finish()
