# SPDX-License-Identifier: Apache-2.0
"""A simulated recording of several scanners, an IMU and wheels on a body that may sway."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from heapq import merge
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cartoloop.errors import ConfigError
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud, SensorEvent
from cartoloop.sensor.pose import Pose
from cartoloop.simulation.floor_plan import World
from cartoloop.simulation.gait import Gait, body_poses
from cartoloop.simulation.imu import ImuModel, imu_readings
from cartoloop.simulation.lidar import Lidar, RangeNoise
from cartoloop.simulation.motion import Motion, delayed, drive
from cartoloop.simulation.odometry import OdometryModel, odometry_poses
from cartoloop.simulation.recording import START_STAMP
from cartoloop.simulation.rig import MountedLidar, sweep_ranges

FloatArray = NDArray[np.float64]

ODOMETRY_RATE = 20.0  # [Hz]
STANDING_S = 3.0  # before a walk [s]
BOUNCE = 0.015  # of a walker [m]


@dataclass(frozen=True)
class RigRecording:
    """What a simulated walk gives; ranges and readings are made when they are asked for.

    Attributes
    ----------
    world : walked through.
    motion, gait : of the body.
    scanners : on it, each with a name of its own.
    imu : its errors, or None without one.
    odometry : its errors, or None without any.
    duration : of the recording [s].
    start_stamp : the time stamp of its beginning [s].
    seed : of all noise.
    """

    world: World
    motion: Motion
    gait: Gait
    scanners: tuple[MountedLidar, ...]
    imu: ImuModel | None
    odometry: OdometryModel | None
    duration: float
    start_stamp: float
    seed: int

    @property
    def name(self) -> str:
        """Of the world walked through."""
        return self.world.name

    @property
    def tape_lines(self) -> FloatArray:
        """Of the world, float64, shape (num_lines, 4) [m], map frame."""
        return self.world.tape_lines

    @property
    def stamps(self) -> FloatArray:
        """Of all scans, in order of time, float64, shape (n,) [s]."""
        return self.start_stamp + self._scan_times()

    @property
    def true_poses(self) -> FloatArray:
        """The body's x [m], y [m], theta [rad] at the stamp of each scan, float64, shape (n, 3)."""
        return self.motion.poses_at(self._scan_times())

    def events(self) -> Iterator[SensorEvent]:
        """Yield what all sensors tell, in order of time, as a reader of the log would."""
        sources = np.random.SeedSequence(self.seed).spawn(len(self.scanners) + 2)
        streams: list[Iterator[SensorEvent]] = [self._imu_events(sources[0])]
        streams.append(self._odometry_events(sources[1]))
        streams += [
            self._scans_of(scanner, source)
            for scanner, source in zip(self.scanners, sources[2:], strict=True)
        ]
        return merge(*streams, key=lambda event: event.time)

    def write_bag(self, path: Path | str) -> None:
        """Write a ROS 1 bag; see :func:`cartoloop.simulation.bag_log.write_bag`."""
        from cartoloop.simulation.bag_log import write_bag

        write_bag(self, Path(path))

    def write_truth(self, path: Path | str) -> None:
        """Write the true pose of each scan as a TUM trajectory."""
        from cartoloop.simulation.log_files import write_truth

        write_truth(self, Path(path))

    def write_relations(self, path: Path | str, num_relations: int = 1000, seed: int = 0) -> None:
        """Write true relative poses of neighbouring scans and across loops as a relations file."""
        from cartoloop.simulation.log_files import write_relations

        write_relations(self, Path(path), num_relations, seed)

    def write_tape_lines(self, path: Path | str) -> None:
        """Write where the world's tape lines are in the map of this recording."""
        from cartoloop.simulation.log_files import write_tape_lines

        write_tape_lines(self, Path(path))

    def _times_of(self, scanner: MountedLidar) -> FloatArray:
        last = self.duration - scanner.delay - scanner.sweep
        count = int(np.floor(max(last, 0.0) * scanner.lidar.rate + 1e-9)) + 1
        return np.round(scanner.delay + np.arange(count) / scanner.lidar.rate, 6)

    def _scan_times(self) -> FloatArray:
        return np.sort(np.concatenate([self._times_of(scanner) for scanner in self.scanners]))

    def _scans_of(
        self, scanner: MountedLidar, source: np.random.SeedSequence
    ) -> Iterator[LaserScan | PointCloud]:
        times, beam_times = self._times_of(scanner), scanner.beam_times()
        noise = RangeNoise(
            scanner.lidar, np.random.default_rng(source), len(times) * len(beam_times)
        )
        geometry, cloud_geometry = scanner.geometry, scanner.cloud_geometry
        directions = scanner.directions()
        for time in times.tolist():
            bodies = body_poses(self.motion, self.gait, time + beam_times)
            ranges = noise.apply(sweep_ranges(self.world.walls, bodies, scanner)[None])[0]
            stamp = self.start_stamp + time
            if scanner.is_cloud:
                seen = (ranges > 0.0) & (ranges < scanner.lidar.range_max)
                points = directions[seen] * ranges[seen, None]
                own_times = beam_times[seen] if scanner.sweep else None
                yield PointCloud(stamp, stamp, points, own_times, cloud_geometry)
            else:
                yield LaserScan(stamp, stamp, ranges, geometry)

    def _imu_events(self, source: np.random.SeedSequence) -> Iterator[Imu]:
        if self.imu is None:
            return
        times = np.arange(int(self.duration * self.imu.rate) + 1) / self.imu.rate
        rng = np.random.default_rng(source)
        linear, angular = imu_readings(self.motion, self.gait, times, self.imu, rng)
        for time, (ax, ay, az), (wx, wy, wz) in zip(
            times.tolist(), linear.tolist(), angular.tolist(), strict=True
        ):
            stamp = self.start_stamp + time
            yield Imu(stamp, stamp, (ax, ay, az), (wx, wy, wz))

    def _odometry_events(self, source: np.random.SeedSequence) -> Iterator[Odometry]:
        if self.odometry is None:
            return
        times = np.arange(int(self.duration * ODOMETRY_RATE) + 1) / ODOMETRY_RATE
        rng = np.random.default_rng(source)
        poses = odometry_poses(self.motion, times, self.odometry, rng)
        for time, pose in zip(times.tolist(), poses.tolist(), strict=True):
            stamp = self.start_stamp + time
            yield Odometry(stamp, stamp, Pose(*pose))


def simulate_rig(
    world: World,
    scanners: Sequence[MountedLidar] | None = None,
    *,
    gait: Gait | None = None,
    imu: ImuModel | None = None,
    odometry: OdometryModel | None = None,
    seed: int = 0,
    motion: Motion | None = None,
    duration: float | None = None,
    start_stamp: float = START_STAMP,
) -> RigRecording:
    """Return the recording of a walk through a world with sensors on a body.

    Parameters
    ----------
    world : its walls, and the route.
    scanners : each with a name of its own; by default the world's, level, measuring all at once.
    gait : how the body sways; by default not at all.
    imu, odometry : how they err; without one by default.
    seed : of all noise; the same seed gives the same recording.
    motion : by default along the world's route at the world's pace.
    duration : how long to record [s]; by default until the way is over.
    start_stamp : the time stamp of the beginning [s].

    Raises
    ------
    ConfigError
        When `duration` is negative or not finite, or two scanners have one name.
    """
    motion = motion or drive(world.route, *world.pace)
    duration = motion.duration if duration is None else duration
    if not 0.0 <= duration < math.inf:
        raise ConfigError(
            f"simulation of {duration:g} s: the duration must be finite and not negative"
        )
    mounted = tuple(scanners or (MountedLidar(world.lidar),))
    if len({scanner.name for scanner in mounted}) < len(mounted):
        raise ConfigError("simulated scanners: give each a name of its own")
    return RigRecording(
        world, motion, gait or Gait(), mounted, imu, odometry, duration, start_stamp, seed
    )


def carry(
    world: World,
    lidar: Lidar | None = None,
    *,
    tilt: float = 0.0,
    distort: bool = False,
    with_odometry: bool | None = None,
    seed: int = 0,
    duration: float | None = None,
) -> RigRecording:
    """Return the recording of somebody who carries a scanner and an IMU along a world's route.

    Parameters
    ----------
    world : its walls, and the route.
    lidar : the scanner; by default the world's.
    tilt : the largest roll and pitch while walking [rad]; the walk starts after some seconds of
        standing, as people do. 0: on wheels, level.
    distort : whether beams are measured one after the other; all at once otherwise.
    with_odometry : whether wheels tell the way; by default as the world has it, if it is level.
    seed : of all noise.
    duration : how long to record [s]; by default until the way is over.

    Raises
    ------
    ConfigError
        When `tilt` is negative or 45 degrees or more, or `duration` negative or not finite.
    """
    if not 0.0 <= tilt < math.radians(45.0):
        raise ConfigError(
            f"simulated tilt of {math.degrees(tilt):g} degrees: give 0 to 44, people sway by 8"
        )
    lidar = lidar or world.lidar
    if with_odometry is None:
        with_odometry = world.has_odometry and tilt == 0.0
    # A scanner turns on behind its back.
    sweep = lidar.field_of_view / math.tau / lidar.rate if distort else 0.0
    standing = STANDING_S if tilt else 0.0
    return simulate_rig(
        world,
        [MountedLidar(lidar, sweep=sweep)],
        gait=Gait(tilt, BOUNCE if tilt else 0.0, standing),
        imu=ImuModel(),
        odometry=OdometryModel() if with_odometry else None,
        seed=seed,
        motion=delayed(drive(world.route, *world.pace), standing),
        duration=duration,
    )
