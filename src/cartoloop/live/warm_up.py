# SPDX-License-Identifier: Apache-2.0
"""All kernels run once before the robot starts: it must not wait for a compiler, nor for a disk."""

from __future__ import annotations

import gc
import math
import sys

from cartoloop.compile_ahead import square_room_ranges
from cartoloop.config import Config, ConstraintSearchConfig, GlobalSlamConfig
from cartoloop.mapper import Mapper
from cartoloop.sensor.events import LaserScan, Odometry, ScanGeometry
from cartoloop.sensor.pose import Pose

SWITCH_S = 0.0002
"""Python's threads take turns so often: no pose waits for longer when another one computes [s]."""

_ROOM = 4.0
_SCANS = 60


def get_ready() -> None:
    """Prepare this process for live mapping: all is compiled, and threads take turns quickly."""
    warm_up()
    gc.collect()
    gc.freeze()
    gc.disable()  # to look through all that was mapped takes longer than to map a scan: see tidy
    sys.setswitchinterval(SWITCH_S)


def tidy() -> None:
    """Free what lies about since the last time; to be called every few seconds."""
    if not gc.isenabled():
        gc.collect(1)
        gc.freeze()  # what is left stays, and need not be looked through again


def warm_up() -> None:
    """Map a small room twice over, with loop closures, and forget it."""
    config = Config()
    local_slam = config.local_slam.model_copy(
        update={"submaps": config.local_slam.submaps.model_copy(update={"num_range_data": 6})}
    )
    search = ConstraintSearchConfig(bound_length=0.0, every_nth_node=1)
    global_slam = GlobalSlamConfig(
        optimize_every_n_nodes=12, constraint_search=search, num_threads=1
    )
    mapper = Mapper(
        config.model_copy(update={"local_slam": local_slam, "global_slam": global_slam})
    )
    geometry = ScanGeometry(-math.pi, math.radians(2.0), 180, 0.1, 30.0)
    for k in range(_SCANS):
        pose = Pose(0.05 * k - 1.5, 0.2 * math.sin(0.3 * k), 0.05 * k)
        ranges = square_room_ranges(_ROOM, pose, geometry.angles)
        mapper.add(Odometry(0.1 * k, 0.1 * k, pose))
        mapper.add(LaserScan(0.1 * k, 0.1 * k, ranges, geometry))
    mapper.finish()
