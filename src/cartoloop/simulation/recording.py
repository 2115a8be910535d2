# SPDX-License-Identifier: Apache-2.0
"""A simulated recording: what all sensors measure along a motion, and the true poses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from heapq import merge
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import ConfigError
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud, SensorEvent
from cartoloop.sensor.pose import Pose
from cartoloop.simulation import bag_log, carmen_log, truth_files
from cartoloop.simulation.difficulties import (
    NO_DIFFICULTIES,
    Difficulties,
    Stream,
    random_stream,
)
from cartoloop.simulation.floor_plan import World
from cartoloop.simulation.gait import Gait, body_poses
from cartoloop.simulation.imu import ImuModel, imu_readings
from cartoloop.simulation.lidar import Lidar, RangeNoise
from cartoloop.simulation.motion import Motion
from cartoloop.simulation.odometry import OdometryModel, odometry_poses
from cartoloop.simulation.odometry_faults import with_faults
from cartoloop.simulation.rig import MountedLidar, sweep_ranges
from cartoloop.simulation.scan_times import Schedule
from cartoloop.simulation.surroundings import Surroundings
from cartoloop.simulation.text_writer import write_text

SCANS_PER_BLOCK = 128
"""Scans simulated at a time: about 13 m of path, 1 MB of ranges."""


def log_format(path: Path) -> Literal["carmen", "bag"]:
    """Return the format that the ending of a log's file name stands for.

    Raises
    ------
    ConfigError
        No format has this ending.
    """
    name = path.name.lower()
    if name.endswith(".bag"):
        return "bag"
    if name.removesuffix(".gz").endswith((".log", ".clf")):
        return "carmen"
    raise ConfigError(
        f"{path}: no simulated recording has this format; give a name that ends in .log, .clf, "
        ".log.gz or .clf.gz (CARMEN log) or .bag (ROS 1 bag)"
    )


class NoiseSeeds(NamedTuple):
    """Independent sources of noise, one for each sensor, so that no sensor changes another's.

    Difficulties draw from streams of their own, which are made of the recording's seed.
    """

    imu: np.random.SeedSequence | None
    odometry: np.random.SeedSequence
    scanners: tuple[np.random.SeedSequence, ...]
    recording: int = 0


@dataclass(frozen=True)
class Recording:
    """Scanners, an IMU and wheels on a body that moves through a world.

    Measurements are simulated when they are asked for, a block at a time.

    Attributes
    ----------
    world : driven through.
    motion, gait : of the body.
    scanners : on the body, each with a name of its own; the first is the main one.
    imu : its errors, or None without an IMU.
    odometry : its errors.
    has_odometry : whether odometry is part of the recording.
    odometry_rate : odometry readings per second [Hz]; None: one with each scan.
    duration : of the recording [s].
    start_stamp : time stamp of its beginning [s].
    seeds : of the noise of each sensor.
    difficulties : sparse scans, a pause, glass, people, faults of the odometry.

    Raises
    ------
    ConfigError
        There are people or glass, and a scanner is not level or moves during a sweep; or the
        recording is too short for the pause.
    """

    world: World
    motion: Motion
    gait: Gait
    scanners: tuple[MountedLidar, ...]
    imu: ImuModel | None
    odometry: OdometryModel
    has_odometry: bool
    odometry_rate: float | None
    duration: float
    start_stamp: float
    seeds: NoiseSeeds
    difficulties: Difficulties = NO_DIFFICULTIES

    def __post_init__(self) -> None:
        _ = self.schedule.pause  # fails here, not while files are written
        if self.difficulties.change_what_is_seen and not all(map(self._is_planar, self.scanners)):
            raise ConfigError(
                "simulated people and glass are seen by level scanners that measure all beams at "
                "once: leave out the tilt and the distortion, or people and glass"
            )

    @property
    def name(self) -> str:
        """Name of the world."""
        return self.world.name

    @property
    def tape_lines(self) -> FloatArray:
        """Tape lines of the world, float64, shape (num_lines, 4) [m], map frame."""
        return self.world.tape_lines

    @property
    def lidar(self) -> Lidar:
        """The main scanner."""
        return self.scanners[0].lidar

    @cached_property
    def stamps(self) -> FloatArray:
        """Time stamps of all scans, increasing, float64, shape (n,) [s]."""
        return np.array(self._stamps_at(self.schedule.of_scans[:, 1]))

    @cached_property
    def true_poses(self) -> FloatArray:
        """The body's x [m], y [m], theta [rad] at each scan, map frame, float64, shape (n, 3)."""
        return self.motion.poses_at(self.schedule.of_scans[:, 0])

    @cached_property
    def odometry_poses(self) -> FloatArray:
        """Poses that the odometry measures, odometry frame, float64, shape (m, 3) [m, rad]."""
        rng = np.random.default_rng(self.seeds.odometry)
        times, faults = self.schedule.of_odometry(), self.difficulties.odometry_faults
        poses = odometry_poses(self.motion, times, self.odometry, rng)
        if not faults:
            return poses
        places = random_stream(self.seeds.recording, Stream.ODOMETRY_FAULTS)
        return with_faults(poses, self.motion.travelled_at(times), faults, places)

    @cached_property
    def ranges(self) -> FloatArray:
        """All ranges of the main scanner, float64, shape (n, num_beams) [m]; kept in memory."""
        return np.concatenate([block for _, block in self.range_blocks()])

    def range_blocks(
        self, scans_per_block: int = SCANS_PER_BLOCK
    ) -> Iterator[tuple[int, FloatArray]]:
        """Yield the ranges of the main scanner in blocks, each with the index of its first scan.

        The ranges do not depend on the size of the blocks.
        """
        yield from self._range_blocks(0, scans_per_block)

    def events(self, with_odometry: bool | None = None) -> Iterator[SensorEvent]:
        """Yield the events of all sensors, in order of time, as a reader of the log would.

        Parameters
        ----------
        with_odometry : whether odometry is included; by default if the recording has it.
        """
        if with_odometry is None:
            with_odometry = self.has_odometry
        streams: list[Iterator[SensorEvent]] = [self._imu_events()]
        if with_odometry:
            streams.append(self._odometry_events())
        streams += [self._scans_of(index) for index in range(len(self.scanners))]
        return merge(*streams, key=lambda event: event.time)

    def write_log(self, path: Path | str) -> None:
        """Write the recording in the format that the ending of the file name stands for.

        Raises
        ------
        ConfigError
            No format has this ending, or the format cannot hold the recording; see `log_format`.
        OutputError
            The file cannot be written.
        """
        if log_format(Path(path)) == "bag":
            self.write_bag(path)
        else:
            self.write_carmen(path)

    def write_carmen(self, path: Path | str, range_decimals: int = 3) -> None:
        """Write a CARMEN log; gzip-compressed if its name ends in ``.gz``.

        Raises
        ------
        ConfigError
            When a CARMEN log cannot hold the recording: it has no IMU, no time of beams, and
            odometry only with each scan of one level scanner.
        """
        if (
            len(self.scanners) > 1
            or not self._is_planar(self.scanners[0])
            or self.imu is not None
            or (self.has_odometry and self.odometry_rate is not None)
        ):
            raise ConfigError(
                f"{path}: a CARMEN log holds one level scanner, no IMU and no time of beams; "
                "choose a name that ends in .bag"
            )
        text = carmen_log.lines(
            self.name, self.lidar, self.events(), self.has_odometry, range_decimals
        )
        write_text(Path(path), text)

    def write_bag(self, path: Path | str) -> None:
        """Write a ROS 1 bag; see :func:`cartoloop.simulation.bag_log.write_bag`."""
        bag_log.write_bag(Path(path), self.scanners, self.start_stamp, self.events())

    def write_truth(self, path: Path | str) -> None:
        """Write the true pose of each scan as a TUM trajectory."""
        truth_files.write_truth(Path(path), self.stamps, self.true_poses)

    def write_relations(self, path: Path | str, num_relations: int = 1000, seed: int = 0) -> None:
        """Write true relative poses of neighbouring scans and across loops as a relations file."""
        truth_files.write_relations(Path(path), self.stamps, self.true_poses, num_relations, seed)

    def write_tape_lines(self, path: Path | str) -> None:
        """Write where the world's tape lines are in the map of this recording, and their lengths.

        Raises
        ------
        ConfigError
            When the world has no tape lines.
        """
        if len(self.tape_lines) == 0:
            raise ConfigError(f"the simulated world {self.name!r} has no tape lines: take 'flat'")
        truth_files.write_tape_lines(Path(path), self.tape_lines, self.true_poses[0])

    def _is_planar(self, scanner: MountedLidar) -> bool:
        """Return whether all beams of a scan are level and measured at once."""
        return self.gait.tilt == 0.0 and scanner.is_level and scanner.sweep == 0.0

    def _stamps_at(self, times: FloatArray) -> list[float]:
        """Return time stamps [s] of times since the beginning, as read back from text."""
        return [float(f"{self.start_stamp + time:.6f}") for time in times.tolist()]

    @cached_property
    def schedule(self) -> Schedule:
        """When everything is measured."""
        return Schedule(
            self.motion,
            self.duration,
            self.scanners,
            self.odometry_rate,
            self.difficulties,
            self.seeds.recording,
        )

    def _range_blocks(self, index: int, scans_per_block: int) -> Iterator[tuple[int, FloatArray]]:
        """Yield ranges of a scanner, shape (scans, rings * beams), and the first scan of each."""
        scanner = self.scanners[index]
        lidar, times = scanner.lidar, self.schedule.of_scanner(scanner)
        beam_times = scanner.beam_times()
        rng = np.random.default_rng(self.seeds.scanners[index])
        noise = RangeNoise(lidar, rng, len(times) * len(beam_times))
        if self._is_planar(scanner):
            surroundings = Surroundings(
                self.world, self.difficulties, self.motion, self.seeds.recording, index
            )
            for first in range(0, len(times), scans_per_block):
                some = times[first : first + scans_per_block]
                poses = self.motion.poses_at(some)
                yield first, noise.apply(surroundings.ranges(poses, some, lidar))
            return
        for scan, time in enumerate(times.tolist()):
            bodies = body_poses(self.motion, self.gait, time + beam_times)
            yield scan, noise.apply(sweep_ranges(self.world.walls, bodies, scanner)[None])

    def _scans_of(self, index: int) -> Iterator[LaserScan | PointCloud]:
        scanner = self.scanners[index]
        stamps = self._stamps_at(self.schedule.of_scanner(scanner) + scanner.clock_offset)
        geometry, cloud_geometry = scanner.geometry, scanner.cloud_geometry
        directions, beam_times = scanner.directions(), scanner.beam_times()
        for first, block in self._range_blocks(index, SCANS_PER_BLOCK):
            for stamp, ranges in zip(stamps[first : first + len(block)], block, strict=True):
                if not scanner.is_cloud:
                    yield LaserScan(stamp, stamp, ranges, geometry)
                    continue
                seen = (ranges > 0.0) & (ranges < scanner.lidar.range_max)
                points = directions[seen] * ranges[seen, None]
                times = beam_times[seen] if scanner.sweep else None
                yield PointCloud(stamp, stamp, points, times, cloud_geometry)

    def _imu_events(self) -> Iterator[Imu]:
        if self.imu is None:
            return
        times = self.schedule.at_rate(self.imu.rate)
        rng = np.random.default_rng(self.seeds.imu)
        linear, angular = imu_readings(self.motion, self.gait, times, self.imu, rng)
        for stamp, (ax, ay, az), (wx, wy, wz) in zip(
            self._stamps_at(times), linear.tolist(), angular.tolist(), strict=True
        ):
            yield Imu(stamp, stamp, (ax, ay, az), (wx, wy, wz))

    def _odometry_events(self) -> Iterator[Odometry]:
        stamps = self._stamps_at(self.schedule.of_odometry())
        for stamp, pose in zip(stamps, self.odometry_poses.tolist(), strict=True):
            yield Odometry(stamp, stamp, Pose(*pose))
