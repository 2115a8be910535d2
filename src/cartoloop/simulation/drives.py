# SPDX-License-Identifier: Apache-2.0
"""Simulated drives and walks: which sensors are on the robot, and how it moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cartoloop.errors import ConfigError
from cartoloop.simulation.difficulties import NO_DIFFICULTIES, Difficulties
from cartoloop.simulation.floor_plan import World
from cartoloop.simulation.gait import Gait
from cartoloop.simulation.imu import ImuModel
from cartoloop.simulation.lidar import Lidar
from cartoloop.simulation.motion import Motion, delayed, drive
from cartoloop.simulation.odometry import OdometryModel
from cartoloop.simulation.recording import NoiseSeeds, Recording
from cartoloop.simulation.rig import MountedLidar

START_STAMP = 1_000_000_000.0
"""Time stamp of the beginning [s]: as large as real ones, so that it needs 64 bits."""

DAY_S = 86_400.0
"""Time from the beginning of a drive to that of the next [s]."""

ODOMETRY_RATE = 20.0
"""Odometry readings per second on a rig [Hz], as common drivers publish it."""

STANDING_S = 3.0
"""Time that a person stands still before walking [s], as people do after starting to record."""

BOUNCE_M = 0.015
"""How far a walking person's body rises and sinks with each step [m]."""

MAX_TILT_DEG = 45.0
"""Limit of the simulated tilt [deg]: beyond it most beams hit floor or ceiling."""


def simulate(
    world: World,
    lidar: Lidar | None = None,
    odometry: OdometryModel | None = None,
    seed: int = 0,
    *,
    with_odometry: bool | None = None,
    motion: Motion | None = None,
    duration: float | None = None,
    start_stamp: float | None = None,
    difficulties: Difficulties = NO_DIFFICULTIES,
) -> Recording:
    """Return the recording of a robot with one level scanner, and odometry with each scan.

    Parameters
    ----------
    world : its walls, and the route.
    lidar : the scanner; by default the world's, in most a SICK-like one of 361 beams over 180
        degrees at 5 Hz.
    odometry : its errors; by default moderate.
    seed : of all noise; the same seed gives the same recording.
    with_odometry : whether odometry is part of the recording; by default as the world has it.
    motion : of the robot; by default along the world's route at the world's pace.
    duration : of the recording [s]; the robot stands still at the end of its route. By default
        until it arrives there.
    start_stamp : time stamp of the first scan [s]; by default a day after the drive before.
    difficulties : sparse scans, glass, people, faults of the odometry, and so on.

    Raises
    ------
    ConfigError
        When `duration` is negative or not finite.

    Notes
    -----
    Scanner and odometry draw from separate sources: another scanner of the same rate leaves the
    odometry's noise as it is, and vice versa.
    """
    motion = motion or drive(world.route, *world.pace)
    seed = _seed_of_drive(world, seed)
    scanner_seed, odometry_seed = np.random.SeedSequence(seed).spawn(2)
    return Recording(
        world=world,
        motion=motion,
        gait=Gait(),
        scanners=(_less_seeing(MountedLidar(lidar or world.lidar, name=""), difficulties),),
        imu=None,
        odometry=_late(odometry or OdometryModel(), difficulties),
        has_odometry=world.has_odometry if with_odometry is None else with_odometry,
        odometry_rate=None,
        duration=_checked(motion.duration if duration is None else duration),
        start_stamp=_start_stamp(world) if start_stamp is None else start_stamp,
        seeds=NoiseSeeds(None, odometry_seed, (scanner_seed,), seed),
        difficulties=difficulties,
    )


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
    start_stamp: float | None = None,
    difficulties: Difficulties = NO_DIFFICULTIES,
) -> Recording:
    """Return the recording of several sensors on a body that may sway.

    Parameters
    ----------
    world : its walls, and the route.
    scanners : each with a name of its own; by default the world's, level, all beams at once.
    gait : how the body sways; by default not at all.
    imu, odometry : their errors; by default there is none.
    seed : of all noise; the same seed gives the same recording.
    motion : by default along the world's route at the world's pace.
    duration : of the recording [s]; by default until the end of the route.
    start_stamp : time stamp of the beginning [s]; by default a day after the drive before.
    difficulties : see :func:`simulate`.

    Raises
    ------
    ConfigError
        When `duration` is negative or not finite, two scanners have one name, or people or glass
        are to be seen by a scanner that is not level.
    """
    motion = motion or drive(world.route, *world.pace)
    mounted = tuple(
        _less_seeing(scanner, difficulties) for scanner in scanners or (MountedLidar(world.lidar),)
    )
    if len({scanner.name for scanner in mounted}) < len(mounted):
        raise ConfigError("simulated scanners: give each a name of its own")
    seed = _seed_of_drive(world, seed)
    imu_seed, odometry_seed, *scanner_seeds = np.random.SeedSequence(seed).spawn(len(mounted) + 2)
    return Recording(
        world=world,
        motion=motion,
        gait=gait or Gait(),
        scanners=mounted,
        imu=imu,
        odometry=_late(odometry or OdometryModel(), difficulties),
        has_odometry=odometry is not None,
        odometry_rate=ODOMETRY_RATE,
        duration=_checked(motion.duration if duration is None else duration),
        start_stamp=_start_stamp(world) if start_stamp is None else start_stamp,
        seeds=NoiseSeeds(imu_seed, odometry_seed, tuple(scanner_seeds), seed),
        difficulties=difficulties,
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
    difficulties: Difficulties = NO_DIFFICULTIES,
) -> Recording:
    """Return the recording of a person who carries a scanner and an IMU along a world's route.

    Parameters
    ----------
    world : its walls, and the route.
    lidar : the scanner; by default the world's.
    tilt : largest roll and pitch while walking [rad]; walking starts after `STANDING_S`. 0: on
        wheels, level.
    distort : whether beams are measured one after the other; all at once otherwise.
    with_odometry : whether there is odometry; by default as the world has it, if `tilt` is 0.
    seed : of all noise.
    duration : of the recording [s]; by default until the end of the route.
    difficulties : see :func:`simulate`.

    Raises
    ------
    ConfigError
        When `tilt` is negative or 45 degrees or more, or `duration` negative or not finite.
    """
    if not 0.0 <= tilt < math.radians(MAX_TILT_DEG):
        raise ConfigError(
            f"simulated tilt of {math.degrees(tilt):g} degrees: give 0 to 44, people sway by 8"
        )
    lidar = lidar or world.lidar
    if with_odometry is None:
        with_odometry = world.has_odometry and tilt == 0.0
    # The mirror rotates at a constant rate, also behind the field of view.
    sweep = lidar.field_of_view / math.tau / lidar.rate if distort else 0.0
    standing = STANDING_S if tilt else 0.0
    return simulate_rig(
        world,
        [MountedLidar(lidar, sweep=sweep)],
        gait=Gait(tilt, BOUNCE_M if tilt else 0.0, standing),
        imu=ImuModel(),
        odometry=OdometryModel() if with_odometry else None,
        seed=seed,
        motion=delayed(drive(world.route, *world.pace), standing),
        duration=duration,
        difficulties=difficulties,
    )


def _start_stamp(world: World) -> float:
    """Return the time stamp of the beginning of a drive [s]."""
    return START_STAMP + (world.drive - 1) * DAY_S


def _seed_of_drive(world: World, seed: int) -> int:
    """Return the seed of the noise of a drive: each has noise of its own."""
    if world.drive == 1:
        return seed
    return int(np.random.SeedSequence((seed, world.drive)).generate_state(1)[0])


def _less_seeing(scanner: MountedLidar, difficulties: Difficulties) -> MountedLidar:
    """Return a scanner to which at least a share of the beams does not come back."""
    lost = difficulties.missing_returns
    if lost <= scanner.lidar.dropout:
        return scanner
    return replace(scanner, lidar=replace(scanner.lidar, dropout=lost))


def _late(odometry: OdometryModel, difficulties: Difficulties) -> OdometryModel:
    """Return odometry that comes late."""
    if difficulties.odometry_delay == 0.0:
        return odometry
    return replace(odometry, time_offset=odometry.time_offset - difficulties.odometry_delay)


def _checked(duration: float) -> float:
    """Return a duration [s] that is finite and not negative."""
    if not 0.0 <= duration < math.inf:
        raise ConfigError(
            f"simulation of {duration:g} s: the duration must be finite and not negative"
        )
    return duration
