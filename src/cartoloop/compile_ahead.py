# SPDX-License-Identifier: Apache-2.0
"""Compiles what global SLAM and the final map need, in a process beside the first that maps.

That one begins with local SLAM, whose kernels it compiles itself, and finds these in the cache when
it comes to them: ``python -m cartoloop.compile_ahead``. The process ends when its standard input
does, at the latest: with the one that started it.
"""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from zlib import crc32

import numpy as np

from cartoloop._jit import kernel_cache_folder
from cartoloop.config import Config, ConstraintSearchConfig, GlobalSlamConfig
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.process_memory import look_seldom_for_garbage
from cartoloop.sensor.pose import FloatArray, Pose
from cartoloop.stage_timer import StageTimer
from cartoloop.submaps.finished_grid import MAX_PROBABILITY, MIN_PROBABILITY
from cartoloop.submaps.node import Node
from cartoloop.submaps.probability_grid import ProbabilityGrid
from cartoloop.submaps.submap import Submap

_WALL_CELLS = 60
_RESOLUTION = 0.05
_HALF_ROOM_M = _WALL_CELLS * _RESOLUTION
_NODES = 24
_NODES_A_SUBMAP = 4


def is_done() -> bool:
    """Return whether what this program compiles is in the cache."""
    return _sign().exists()


def _sign() -> Path:
    """Return the file that tells of it; copies of the program keep their kernels apart."""
    return kernel_cache_folder() / f"ahead-{crc32(os.fsencode(__file__)):08x}"


def compile_ahead() -> None:
    """Close loops in a small room with global SLAM, and compose its map.

    The search comes last: the process that maps needs it soon after the first adjustment, and
    compiles it itself while the rest is compiled here.
    """
    slam = _close_loops(every_nth_node=_NODES**2)  # too many
    grids = [grid for _, grid in sorted(slam.finished_grids().items())]
    compose_map(grids, slam.graph.submap_poses, Config().local_slam.submaps)
    _close_loops(every_nth_node=1)
    _sign().touch()


def _close_loops(every_nth_node: int) -> GlobalSlam:
    """Return what became of the small room, in which one node in so many is searched for."""
    search = ConstraintSearchConfig(
        every_nth_node=every_nth_node,
        every_nth_well_constrained_node=every_nth_node,
        final_every_nth_node=1,
    )
    config = GlobalSlamConfig(
        optimize_every_n_nodes=_NODES // 2, constraint_search=search, num_threads=1
    )
    slam = GlobalSlam(config, StageTimer())
    try:
        active: tuple[Submap, ...] = ()
        for node in _nodes():
            slam.add_node(node)
            active = node.submaps
        slam.finish(active)
    finally:
        slam.close()
    return slam


def _nodes() -> Iterator[Node]:
    """Yield scans from the middle of a square room, and submaps of a few each."""
    points = _walls()
    previous, current = None, Submap(0, Pose(0.0, 0.0, 0.0), _room())
    for k in range(_NODES):
        done = None
        if k and k % _NODES_A_SUBMAP == 0:
            done = previous
            previous, current = current, Submap(current.index + 1, Pose(0.0, 0.0, 0.0), _room())
        pose = Pose(1e-3 * k, 0.0, 0.0)
        submaps = (current,) if previous is None else (previous, current)
        yield Node(k, 0.1 * k, pose, points, submaps, np.diag((1e4, 1e4, 1e4)), done)


def _room() -> ProbabilityGrid:
    grid = ProbabilityGrid(_RESOLUTION)
    grid.cover(-_WALL_CELLS, -_WALL_CELLS, _WALL_CELLS, _WALL_CELLS)
    first = -_WALL_CELLS - grid.first_row
    inside = slice(first, first + 2 * _WALL_CELLS + 1)
    grid.cells[inside, inside] = MAX_PROBABILITY
    inner = slice(first + 1, first + 2 * _WALL_CELLS)
    grid.cells[inner, inner] = MIN_PROBABILITY
    return grid


def _walls() -> FloatArray:
    """Return what a scanner sees from the middle of the room, shape (n, 2) [m]."""
    angles = np.linspace(-math.pi, math.pi, 180, endpoint=False)
    x, y = np.cos(angles), np.sin(angles)
    distances = _HALF_ROOM_M / np.maximum(np.abs(x), np.abs(y))
    return np.column_stack((distances * x, distances * y))


def _end_with_input() -> None:
    sys.stdin.buffer.read()
    os._exit(0)


def main() -> None:
    """Compile, unless the process that asked for it ends before."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # meant for the process that started this one
    look_seldom_for_garbage()
    threading.Thread(target=_end_with_input, daemon=True).start()
    compile_ahead()


if __name__ == "__main__":
    main()
