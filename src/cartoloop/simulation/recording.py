# SPDX-License-Identifier: Apache-2.0
"""A simulated recording: scans and odometry as a robot logs them, and the truth beside them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cartoloop.errors import ConfigError
from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent
from cartoloop.sensor.pose import Pose
from cartoloop.simulation.floor_plan import World
from cartoloop.simulation.lidar import Lidar, measured_ranges, true_ranges
from cartoloop.simulation.motion import Motion, drive
from cartoloop.simulation.odometry import OdometryModel, odometry_poses

FloatArray = NDArray[np.float64]

# A time stamp of many digits, as real logs have: whoever keeps it in too few bits is found out.
START_STAMP = 1_000_000_000.0


@dataclass(frozen=True, slots=True)
class Recording:
    """What a simulated drive gave.

    Attributes
    ----------
    name : of the world driven through.
    lidar : the scanner.
    stamps : float64, shape (n,) [s], whole microseconds, one a scan.
    ranges : float64, shape (n, num_beams) [m], as measured.
    true_poses : float64, shape (n, 3), the robot's x [m], y [m], theta [rad] in the map frame,
        exactly where each scan was taken.
    odometry_poses : float64, shape (n, 3), what the odometry told with each scan, odometry frame.
    """

    name: str
    lidar: Lidar
    stamps: FloatArray
    ranges: FloatArray
    true_poses: FloatArray
    odometry_poses: FloatArray

    def events(self, with_odometry: bool = True) -> Iterator[SensorEvent]:
        """Yield odometry and scan in turn, in order of time, as a reader of the log would."""
        geometry = self.lidar.geometry
        for stamp, ranges, odometry in zip(
            self.stamps.tolist(), self.ranges, self.odometry_poses.tolist(), strict=True
        ):
            if with_odometry:
                yield Odometry(stamp, stamp, Pose(*odometry))
            yield LaserScan(stamp, stamp, ranges, geometry)

    def write_carmen(self, path: Path | str, range_decimals: int = 3) -> None:
        """Write scans and odometry, not the truth, as a CARMEN log; compressed if it ends in .gz.

        See :func:`cartoloop.simulation.log_files.write_carmen`.
        """
        from cartoloop.simulation.log_files import write_carmen

        write_carmen(self, Path(path), range_decimals)

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


def simulate(
    world: World,
    lidar: Lidar | None = None,
    odometry: OdometryModel | None = None,
    seed: int = 0,
    *,
    motion: Motion | None = None,
    duration: float | None = None,
    start_stamp: float = START_STAMP,
) -> Recording:
    """Return the recording of a drive through a world.

    Parameters
    ----------
    world : its walls, and the route.
    lidar : the scanner; by default a SICK-like one of 361 beams over 180 degrees at 5 Hz.
    odometry : how the odometry errs; by default moderately.
    seed : of all noise; the same seed gives the same recording.
    motion : how the robot moves; by default :func:`cartoloop.simulation.motion.drive` of the route.
    duration : how long to record [s]; the robot stands still when its way is over. By default
        until then.
    start_stamp : the time stamp of the first scan [s].

    Raises
    ------
    ConfigError
        When `duration` is negative.

    Notes
    -----
    Scanner and odometry draw from separate sources: another scanner leaves the odometry's noise
    alone as long as its rate is the same, and the other way round.
    """
    lidar = lidar or Lidar()
    odometry = odometry or OdometryModel()
    motion = motion or drive(world.route)
    if duration is None:
        duration = motion.duration
    if duration < 0.0:
        raise ConfigError(f"simulation of {duration:g} s: the duration must not be negative")
    num_scans = int(np.floor(duration * lidar.rate + 1e-9)) + 1
    times = np.round(np.arange(num_scans) / lidar.rate, 6)
    # As read back from the text of a log, to the last bit.
    stamps = np.array([float(f"{start_stamp + time:.6f}") for time in times.tolist()])
    lidar_rng, odometry_rng = np.random.default_rng(seed).spawn(2)
    true_poses = motion.poses_at(times)
    ranges = true_ranges(world.walls, true_poses, lidar)
    return Recording(
        name=world.name,
        lidar=lidar,
        stamps=stamps,
        ranges=measured_ranges(ranges, lidar, lidar_rng),
        true_poses=true_poses,
        odometry_poses=odometry_poses(motion, times, odometry, odometry_rng),
    )
