# SPDX-License-Identifier: Apache-2.0
"""One closed drive again and again through one localiser: growth of memory, time and errors."""

from __future__ import annotations

import gc
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import NamedTuple

import numpy as np

from bench.localisation.drives import aligned, corners_of, error, mapped, shifted
from bench.localisation.figures import rms
from bench.localisation.world_rows import Progress
from bench.record import Figure, Row
from cartoloop.arrays import FloatArray
from cartoloop.localisation.known_map import KnownMap, known_map_of
from cartoloop.localisation.localizer import Localizer
from cartoloop.mapper import Mapper
from cartoloop.runtime.process_memory import PeriodicRelease, relax_gc, set_malloc_thresholds
from cartoloop.sensor.events import Odometry, SensorEvent
from cartoloop.sensor.pose import Pose, compose, compose_all, inverse
from cartoloop.simulation import Lidar, drive, make_world, simulate

WORLD = "office"

LIDAR = Lidar(num_beams=360, angle_min=-math.pi, angle_increment=math.tau / 360, rate=10.0)
"""The robot's scanner."""

PART_S = 3600.0
"""The first and the last part of the drive, which are compared, are this long [s], or a quarter of
the drive if that is shorter."""


def long_drive_rows(hours: float, progress: Progress) -> Iterator[Row]:
    """Return how errors, time and memory change of a robot that drives on for hours.

    Parameters
    ----------
    hours : of the drive.
    """
    progress(f"{WORLD}: mapping, and driving for {hours:g} hours")
    set_malloc_thresholds()  # as `cartoloop locate` does
    lap = _closed_lap()
    num_laps = max(math.ceil(3600.0 * hours / lap.period), 4)
    laps_a_part = min(max(round(PART_S / lap.period), 1), num_laps // 4)
    num_scans = len(lap.truth)
    # Written at once, so that they do not count as growth.
    found = _Found(*(np.full(num_laps * num_scans, np.nan) for _ in range(2)))
    memory = [math.nan] * num_laps
    localizer = Localizer(lap.known, at=Pose(*lap.truth[0].tolist()))
    relax_gc()
    release = PeriodicRelease()
    for number in range(num_laps):
        _drive(localizer, lap, number, found, release)
        gc.collect()
        memory[number] = _memory_mb()
        own = found.errors[number * num_scans : (number + 1) * num_scans]
        progress(
            f"lap {number + 1} of {num_laps}: {100.0 * _rms(own):.2f} cm, {memory[number]:.1f} MB"
        )
    part = laps_a_part * num_scans
    processor = 1e3 * found.processor[np.isfinite(found.processor)]
    yield Row(
        {"what": "hours of driving", "drive": f"{WORLD}, 10 Hz, 360 beams", "map": "ours"},
        {
            "hours": Figure.exact(num_laps * lap.period / 3600.0, better=None),
            "scans": Figure.exact(len(processor), better=None),
            "without a pose": Figure.exact(len(processor) - int(np.isfinite(found.errors).sum())),
            "rmse, first part": Figure.exact(100.0 * _rms(found.errors[:part]), "cm"),
            "rmse, last part": Figure.exact(100.0 * _rms(found.errors[-part:]), "cm"),
            "memory after the first part": Figure(memory[laps_a_part - 1], "MB"),
            "at the end": Figure(memory[-1], "MB"),
            "processor time of a scan": Figure(float(np.median(processor)), "ms"),
            "mean": Figure(float(processor.mean()), "ms"),
            "99%": Figure(float(np.quantile(processor, 0.99)), "ms"),
        },
    )


class _Lap(NamedTuple):
    """A map, and a drive in it that ends as it began.

    Attributes
    ----------
    known : the map.
    events : of the drive.
    truth : float64, shape (n, 3), tf_map_tracking of each scan.
    period : from one lap to the next [s].
    """

    known: KnownMap
    events: list[SensorEvent]
    truth: FloatArray
    period: float


class _Found(NamedTuple):
    """What was measured of each scan of all laps; NaN: nothing.

    Attributes
    ----------
    errors : of located scans [m].
    processor : time [s].
    """

    errors: FloatArray
    processor: FloatArray


def _closed_lap() -> _Lap:
    world = make_world(WORLD, 0)
    first = simulate(world, seed=0)
    result = mapped(list(first.events()), Mapper())
    corners = corners_of(first.true_poses)
    # The last corner turns the robot to where it faced at first.
    ahead = corners[:1] + 0.01 * (corners[1] - corners[0])
    route = np.ascontiguousarray(np.concatenate((corners, corners[-2::-1], ahead)))
    again = simulate(replace(world, route=route), LIDAR, seed=1, motion=drive(route, *world.pace))
    tf_map_world = aligned(first.true_poses[: len(result.stamps)], result.trajectory)
    truth = compose_all(np.array(tf_map_world), again.true_poses)
    events = list(again.events())
    period = events[-1].time - events[0].time + 1.0 / LIDAR.rate
    return _Lap(known_map_of(result), events, truth, period)


def _drive(
    localizer: Localizer, lap: _Lap, number: int, found: _Found, release: PeriodicRelease
) -> None:
    """Add a lap, whose odometry goes on from where that of the lap before ended."""
    first = next(event for event in lap.events if isinstance(event, Odometry))
    before = localizer.odometry_pose
    jump = None if before is None else compose(before, inverse(first.tf_odom_tracking))
    for event in lap.events:
        moved = shifted(event, -number * lap.period, jump)
        begin = process_time()
        answer = localizer.add(moved)
        if answer is None:
            continue
        release.after_scan()
        spent = process_time() - begin
        scan = localizer.num_scans - 1
        found.processor[scan] = spent
        if answer.tf_map_tracking is not None:
            truth = lap.truth[scan % len(lap.truth)]
            found.errors[scan] = error(truth, answer.tf_map_tracking)[0]


def _rms(errors: FloatArray) -> float:
    return rms(errors[np.isfinite(errors)])


def _memory_mb() -> float:
    """Return the memory of this process now [MB]; NaN where the system does not say."""
    status = Path("/proc/self/status")
    lines = status.read_text(encoding="ascii").splitlines() if status.exists() else []
    return next((float(s.split()[1]) * 1024 / 1e6 for s in lines if s[:6] == "VmRSS:"), math.nan)
