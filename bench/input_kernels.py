# SPDX-License-Identifier: Apache-2.0
"""Workloads of reading, calibrating, deskewing and projecting, and of simulating scans."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from functools import partial

import numpy as np

from bench.record import Case
from bench.workload import Workload
from cartoloop.arrays import FloatArray
from cartoloop.config import SensorConfig
from cartoloop.kernels.turn_errors import prediction_errors
from cartoloop.local_slam.clock_offset import ERRORS, clock_offset
from cartoloop.readers.carmen_lines import read_scan_line
from cartoloop.readers.ros.raw_messages import decode_multi_echo
from cartoloop.sensor.events import LaserScan, PointCloud
from cartoloop.sensor.packed_points import pack_points
from cartoloop.sensor.range_filter import RangeFilter
from cartoloop.sensor.sweep_motion import SweepMotion
from cartoloop.simulation import make_world
from cartoloop.simulation.lidar import make_lidar, true_ranges
from cartoloop.simulation.rig import MountedLidar, sweep_ranges

INPUT_KERNELS = (
    "read scan line", "read echoes", "filter in motion", "filter a cloud", "simulate a scan",
    "simulate a cloud", "pack", "clock offset", "veer",
)  # fmt: skip

RINGS_DEG = np.arange(-15.0, 16.0, 2.0)
"""Elevations of the rings of a common 3D scanner."""

SWEEP_S = 0.02
"""Time from the first to the last beam."""


def input_workloads() -> Iterator[Workload]:
    """Yield the workloads, all of the museum from the start of the visitor's route."""
    world, lidar = make_world("museum"), make_lidar("backpack")
    case: Case = {"input": f"museum, {len(world.walls):,} walls"}
    pose = np.array(((*world.route[0].tolist(), 0.3),))
    beams = lidar.num_beams
    simulate = partial(true_ranges, world.walls, pose, lidar)
    yield Workload("simulate a scan", ("wall_ranges",), case, simulate, beams, "beams")

    ranges = simulate()[0]
    line = b"FLASER %d %s 0.0 0.0 0.0 0.0 0.0 0.0 0.0 host 0.0" % (
        beams,
        b" ".join(b"%.3f" % measured for measured in np.minimum(ranges, lidar.no_return)),
    )
    yield Workload(
        "read scan line", ("decimal_text",), case, partial(read_scan_line, line), beams, "beams"
    )

    returns = (
        RangeFilter(SensorConfig())
        .apply(LaserScan(0.0, 0.0, ranges, MountedLidar(lidar).geometry))
        .returns
    )
    yield Workload(
        "pack", ("packed_points",), case, partial(pack_points, returns), len(returns), "points"
    )

    echoes = _message_of_echoes(ranges)
    yield Workload(
        "read echoes", ("nested_lists",), case,
        partial(decode_multi_echo, echoes, is_ros1=True), beams, "beams",
    )  # fmt: skip

    yield from _calibration_workloads(case)

    scanner = MountedLidar(lidar, sweep=SWEEP_S, pitch=0.05)
    turning = SweepMotion(0.0, SWEEP_S, np.array([(0.0,) * 5, (0.02, 0.0, 0.01, 0.01, 0.02)]))
    range_filter = RangeFilter(SensorConfig())
    scan = LaserScan(0.0, 0.0, ranges, scanner.geometry)
    yield Workload(
        "filter in motion", ("sweep_projection", "voxel_filter"), case,
        partial(range_filter.apply, scan, turning), beams, "beams",
    )  # fmt: skip

    rings = MountedLidar(lidar, sweep=SWEEP_S, elevations=tuple(map(math.radians, RINGS_DEG)))
    bodies = np.zeros((len(rings.directions()), 5))
    bodies[:, :3] = pose
    sweep = partial(sweep_ranges, world.walls, bodies, rings)
    yield Workload("simulate a cloud", ("ray_ranges",), case, sweep, len(bodies), "beams")

    points = rings.directions() * sweep()[:, None]
    cloud = PointCloud(0.0, 0.0, points, rings.beam_times(), rings.cloud_geometry)
    yield Workload(
        "filter a cloud", ("cloud_projection", "voxel_filter"), case,
        partial(range_filter.apply, cloud, turning), len(points), "points",
    )  # fmt: skip


def _calibration_workloads(case: Case) -> Iterator[Workload]:
    """Yield the search for the clock offset of odometry, and the fit of its veer."""
    rng = np.random.default_rng(0)
    times, heading = 0.2 * np.arange(500.0), np.cumsum(rng.normal(0.0, 0.05, 500))
    turns, turning = np.diff(heading), np.ones(499, dtype=np.bool_)
    yield Workload(
        "clock offset", ("turn_errors",), case,
        partial(clock_offset, times, turns, turning, times + 0.14, heading), len(turns), "turns",
    )  # fmt: skip
    terms = rng.normal(0.0, 1.0, (100, 4))
    turned = terms @ np.array((0.0, 0.02, 0.01, 0.01)) + 0.01 * rng.standard_normal(100)
    priors = np.zeros(4), np.full(4, 0.05)
    yield Workload(
        "veer", ("turn_errors",), case,
        partial(prediction_errors, turned, terms, *priors, ERRORS[:], 4), len(turned), "stretches",
    )  # fmt: skip


def _message_of_echoes(ranges: FloatArray) -> bytes:
    """Return a MultiEchoLaserScan as ROS 1 sends it, every other beam with a second echo."""
    header = struct.pack("<IIII7f", 0, 0, 0, 0, -1.5, 1.5, 3.0 / len(ranges), 0.0, 0.0, 0.0, 30.0)
    lists = b"".join(
        struct.pack("<I2f", 2, measured, measured) if beam % 2 else struct.pack("<If", 1, measured)
        for beam, measured in enumerate(ranges)
    )
    return header + 2 * (struct.pack("<I", len(ranges)) + lists)
