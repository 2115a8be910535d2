# SPDX-License-Identifier: Apache-2.0
"""A simulated recording: scans and odometry as a robot logs them, and the truth beside them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cartoloop.errors import ConfigError
from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent
from cartoloop.sensor.pose import Pose
from cartoloop.simulation.floor_plan import World
from cartoloop.simulation.lidar import Lidar, RangeNoise, true_ranges, walls_within
from cartoloop.simulation.motion import Motion, drive
from cartoloop.simulation.odometry import OdometryModel, odometry_poses

FloatArray = NDArray[np.float64]

# A time stamp of many digits, as real logs have: whoever keeps it in too few bits is found out.
START_STAMP = 1_000_000_000.0

SCANS_PER_BLOCK = 128  # simulated at a time: some 13 m of way, a megabyte of ranges


@dataclass(frozen=True)
class Recording:
    """What a simulated drive gives. Its ranges are made when they are asked for.

    Attributes
    ----------
    world : driven through.
    lidar : the scanner.
    has_odometry : whether the odometry is part of the recording.
    stamps : float64, shape (n,) [s], whole microseconds, one a scan.
    true_poses : float64, shape (n, 3), the robot's x [m], y [m], theta [rad] in the map frame,
        exactly where each scan was taken.
    odometry_poses : float64, shape (n, 3), what the odometry tells with each scan, odometry frame.
    noise_seed : of what the scanner measures.
    """

    world: World
    lidar: Lidar
    has_odometry: bool
    stamps: FloatArray
    true_poses: FloatArray
    odometry_poses: FloatArray
    noise_seed: np.random.SeedSequence

    @property
    def name(self) -> str:
        """Of the world driven through."""
        return self.world.name

    @property
    def tape_lines(self) -> FloatArray:
        """Of the world, float64, shape (num_lines, 4) [m], map frame."""
        return self.world.tape_lines

    @cached_property
    def ranges(self) -> FloatArray:
        """All ranges as measured, float64, shape (n, num_beams) [m]; kept from then on."""
        return np.concatenate([block for _, block in self.range_blocks()])

    def range_blocks(
        self, scans_per_block: int = SCANS_PER_BLOCK
    ) -> Iterator[tuple[int, FloatArray]]:
        """Yield the ranges as measured, some scans at a time, each block with its first scan.

        The ranges are the same, whatever the size of the blocks.
        """
        num_scans, lidar = len(self.stamps), self.lidar
        noise = RangeNoise(
            lidar, np.random.default_rng(self.noise_seed), num_scans * lidar.num_beams
        )
        # The scanner may sit beside the robot's place.
        reach = lidar.range_max + math.hypot(*lidar.tf_tracking_sensor[:2])
        for first in range(0, num_scans, scans_per_block):
            poses = self.true_poses[first : first + scans_per_block]
            walls = walls_within(self.world.walls, poses, reach)
            yield first, noise.apply(true_ranges(walls, poses, lidar))

    def events(self, with_odometry: bool | None = None) -> Iterator[SensorEvent]:
        """Yield odometry and scan in turn, in order of time, as a reader of the log would.

        Ranges are simulated on the way: however long the recording is, few are in memory.

        Parameters
        ----------
        with_odometry : whether to tell it; by default if the recording has it.
        """
        if with_odometry is None:
            with_odometry = self.has_odometry
        geometry = self.lidar.geometry
        for first, block in self.range_blocks():
            own = slice(first, first + len(block))
            for stamp, ranges, odometry in zip(
                self.stamps[own].tolist(), block, self.odometry_poses[own].tolist(), strict=True
            ):
                if with_odometry:
                    yield Odometry(stamp, stamp, Pose(*odometry))
                yield LaserScan(stamp, stamp, ranges, geometry)

    def write_carmen(
        self, path: Path | str, range_decimals: int = 3, with_odometry: bool | None = None
    ) -> None:
        """Write scans and odometry, not the truth, as a CARMEN log; compressed if it ends in .gz.

        See :func:`cartoloop.simulation.carmen_log.write_carmen`.
        """
        from cartoloop.simulation.carmen_log import write_carmen

        write_carmen(self, Path(path), range_decimals, with_odometry)

    def write_truth(self, path: Path | str) -> None:
        """Write the true pose of each scan as a TUM trajectory.

        See :func:`cartoloop.simulation.log_files.write_truth`.
        """
        from cartoloop.simulation.log_files import write_truth

        write_truth(self, Path(path))

    def write_relations(self, path: Path | str, num_relations: int = 1000, seed: int = 0) -> None:
        """Write true relative poses of neighbouring scans and across loops as a relations file.

        See :func:`cartoloop.simulation.log_files.write_relations`.
        """
        from cartoloop.simulation.log_files import write_relations

        write_relations(self, Path(path), num_relations, seed)

    def write_tape_lines(self, path: Path | str) -> None:
        """Write where the world's tape lines are in the map of this recording, and their lengths.

        See :func:`cartoloop.simulation.log_files.write_tape_lines`.
        """
        from cartoloop.simulation.log_files import write_tape_lines

        write_tape_lines(self, Path(path))


def simulate(
    world: World,
    lidar: Lidar | None = None,
    odometry: OdometryModel | None = None,
    seed: int = 0,
    *,
    with_odometry: bool | None = None,
    motion: Motion | None = None,
    duration: float | None = None,
    start_stamp: float = START_STAMP,
) -> Recording:
    """Return the recording of a drive through a world.

    Parameters
    ----------
    world : its walls, and the route.
    lidar : the scanner; by default the world's, in most a SICK-like one of 361 beams over 180
        degrees at 5 Hz.
    odometry : how the odometry errs; by default moderately.
    seed : of all noise; the same seed gives the same recording.
    with_odometry : whether the odometry is part of the recording; by default as the world has it.
    motion : how the robot moves; by default it drives along the world's route at the world's pace.
    duration : how long to record [s]; the robot stands still when its way is over. By default
        until then.
    start_stamp : the time stamp of the first scan [s].

    Raises
    ------
    ConfigError
        When `duration` is negative or not finite.

    Notes
    -----
    Scanner and odometry draw from separate sources: another scanner leaves the odometry's noise
    alone as long as its rate is the same, and the other way round.
    """
    odometry = odometry or OdometryModel()
    motion = motion or drive(world.route, *world.pace)
    if duration is None:
        duration = motion.duration
    if not 0.0 <= duration < math.inf:
        raise ConfigError(
            f"simulation of {duration:g} s: the duration must be finite and not negative"
        )
    lidar = lidar or world.lidar
    num_scans = int(np.floor(duration * lidar.rate + 1e-9)) + 1
    times = np.round(np.arange(num_scans) / lidar.rate, 6)
    # As read back from the text of a log, to the last bit.
    stamps = np.array([float(f"{start_stamp + time:.6f}") for time in times.tolist()])
    noise_seed, odometry_seed = np.random.SeedSequence(seed).spawn(2)
    return Recording(
        world=world,
        lidar=lidar,
        has_odometry=world.has_odometry if with_odometry is None else with_odometry,
        stamps=stamps,
        true_poses=motion.poses_at(times),
        odometry_poses=odometry_poses(
            motion, times, odometry, np.random.default_rng(odometry_seed)
        ),
        noise_seed=noise_seed,
    )
