# SPDX-License-Identifier: Apache-2.0
"""Compiles the kernels of global SLAM and of the final map, in a second process of a first run.

``python -m cartoloop.compile_ahead``. The process that maps compiles the kernels of local SLAM
itself meanwhile, and finds the others in the cache. This process ends at the latest when its
standard input is closed: with the process that started it.
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
from cartoloop.arrays import FloatArray
from cartoloop.config import (
    Config,
    ConstraintSearchConfig,
    GlobalSlamConfig,
    WideSearchConfig,
)
from cartoloop.global_slam.claims import Claims
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.map_output.surveyed_floor import surveyed
from cartoloop.quality.agreement import agreement
from cartoloop.quality.corridor_shifts import fitting_shifts
from cartoloop.quality.encounters import shifts_in
from cartoloop.quality.pairs import agreement_limits, cell_grid
from cartoloop.quality.scan_changes import num_changed
from cartoloop.quality.slides import fits_along
from cartoloop.runtime.process_memory import relax_gc
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.sensor.wall_normals import chord_ratio
from cartoloop.submaps.finished_grid import MAX_PROBABILITY, MIN_PROBABILITY
from cartoloop.submaps.node import Node
from cartoloop.submaps.probability_grid import ProbabilityGrid
from cartoloop.submaps.submap import Submap

_WALL_CELLS = 60
_RESOLUTION = 0.05
"""The walls are this many pixels from the middle of the room; edge of a pixel [m]."""

_NODES, _NODES_PER_SUBMAP = 24, 4
"""The smallest numbers for which loops close."""


def is_done() -> bool:
    """Return whether all that this program compiles is in the cache."""
    return _done_file().exists()


def _done_file() -> Path:
    """Return the file that marks a complete cache; each copy of the program has its own."""
    return kernel_cache_folder() / f"ahead-{crc32(os.fsencode(__file__)):08x}"


def compile_ahead() -> None:
    """Close loops in a small room with global SLAM, and compose its map.

    The search comes last: the process that maps needs it soon after the first adjustment, and
    compiles it itself while the rest is compiled here.
    """
    slam = _close_loops(every_nth_node=_NODES**2)  # no search
    grids = [grid for _, grid in sorted(slam.finished_grids().items())]
    whole = compose_map(grids, slam.graph.submap_poses, Config().local_slam.submaps)
    surveyed(whole, Config().map_output.free_thresh, slam.graph.submap_poses[:, :2])
    scans = slam.node_points.take(np.zeros(1, dtype=np.int64))
    limits = agreement_limits(_RESOLUTION, math.inf)
    agreement(cell_grid(grids[0]), limits, scans, np.zeros((1, 3)))
    shifts_in(grids[0], ScanPoints.of([scans[0]]), _RESOLUTION)
    fits_along(cell_grid(grids[0]), ScanPoints.of([scans[0]]), np.array([[1.0, 0.0]]), np.zeros(1))
    num_changed(scans[0], scans[0][:-1], scans[0][1:])
    chord_ratio(scans[0], math.inf)
    one = np.zeros(1, dtype=np.int64)
    fitting_shifts(grids[0], scans, np.zeros((1, 3)), one, np.array([[1.0, 0.0]]))
    Claims.of([]).agreement(WideSearchConfig())
    _close_loops(every_nth_node=1)
    _done_file().touch()


def _close_loops(every_nth_node: int) -> GlobalSlam:
    """Return global SLAM after mapping the room, with one node in `every_nth_node` searched."""
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
    """Yield scans from the middle of a square room, with submaps of a few scans each."""
    angles = np.linspace(-math.pi, math.pi, 180, endpoint=False)
    ranges = square_room_ranges(_WALL_CELLS * _RESOLUTION, IDENTITY, angles)
    points = ranges[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    previous, current = None, Submap(0, Pose(0.0, 0.0, 0.0), _room())
    for k in range(_NODES):
        done = None
        if k and k % _NODES_PER_SUBMAP == 0:
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


def square_room_ranges(half_edge: float, pose: Pose, angles: FloatArray) -> FloatArray:
    """Return the ranges [m] to the walls of a square room around the origin, shape (n,).

    Parameters
    ----------
    half_edge : distance of the walls from the origin [m].
    pose : of the scanner, inside.
    angles : of its beams [rad], shape (n,).
    """
    dx, dy = np.cos(pose.theta + angles), np.sin(pose.theta + angles)
    with np.errstate(divide="ignore"):
        ranges: FloatArray = np.minimum(
            (np.copysign(half_edge, dx) - pose.x) / dx, (np.copysign(half_edge, dy) - pose.y) / dy
        )
    return ranges


def _end_with_input() -> None:
    sys.stdin.buffer.read()
    os._exit(0)


def main() -> None:
    """Compile until done or until the parent process ends."""
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # it is sent to the process that started this one, too
    relax_gc()
    threading.Thread(target=_end_with_input, daemon=True).start()
    compile_ahead()


if __name__ == "__main__":
    main()
