# SPDX-License-Identifier: Apache-2.0
"""When the sensors of a simulated recording measure: one scan each metre, none in a pause."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import ConfigError
from cartoloop.simulation.difficulties import Difficulties, Stream, random_stream
from cartoloop.simulation.motion import Motion
from cartoloop.simulation.rig import MountedLidar

TURN_PER_SCAN = math.radians(20.0)
"""Turn after which a scan is kept in a recording of sparse scans [rad]: in those of outdoor places
the headings of neighbouring scans differ by 8 to 24 degrees in turns."""

LARGEST_PAUSED_TURN = math.radians(90.0)
"""Largest turn that a pause hides [rad]."""

SHARP = 0.8
"""A pause is put where the turn is at least this share of the largest that it could hide."""

PAUSE_PART = (0.15, 0.85)
"""The part of the recording in which the pause is."""


class Pause(NamedTuple):
    """From when until when nothing is recorded [s]."""

    begin: float
    end: float

    def left_out(self, times: FloatArray) -> FloatArray:
        """Return the times outside the pause."""
        kept: FloatArray = times[(times <= self.begin) | (times >= self.end)]
        return kept


@dataclass(frozen=True)
class Schedule:
    """When each sensor of a recording measures, in seconds since its beginning.

    Attributes
    ----------
    motion : of the body.
    duration : of the recording [s].
    scanners : on the body.
    odometry_rate : odometry readings per second [Hz]; None: one whenever a scanner turns round.
    difficulties : spacing of the scans, and a pause.
    seed : of the recording.
    """

    motion: Motion
    duration: float
    scanners: Sequence[MountedLidar]
    odometry_rate: float | None
    difficulties: Difficulties
    seed: int

    @cached_property
    def pause(self) -> Pause | None:
        """When nothing is recorded, if ever."""
        seconds = self.difficulties.pause
        if seconds <= 0.0:
            return None
        places = random_stream(self.seed, Stream.PAUSE)
        return pause_with_a_turn(self.motion, self.duration, seconds, places)

    @cached_property
    def of_scans(self) -> FloatArray:
        """When each scan is taken, and the time on its scanner's clock, by the latter, (n, 2)."""
        moments = [
            np.column_stack((times, times + scanner.clock_offset))
            for scanner in self.scanners
            for times in [self.of_scanner(scanner)]
        ]
        together = np.vstack(moments)
        ordered: FloatArray = together[np.argsort(together[:, 1], kind="stable")]
        return ordered

    def of_scanner(self, scanner: MountedLidar) -> FloatArray:
        """Return when the scans of a scanner are taken, shape (n,)."""
        times, spacing = self._sweeps(scanner), self.difficulties.scan_spacing
        return spaced(times, self.motion, spacing) if spacing else times

    def of_odometry(self) -> FloatArray:
        """Return the times of odometry readings, shape (n,)."""
        if self.odometry_rate is not None:
            return self.at_rate(self.odometry_rate)
        return np.sort(np.concatenate([self._sweeps(scanner) for scanner in self.scanners]))

    def at_rate(self, rate: float) -> FloatArray:
        """Return the times of a sensor that measures `rate` times a second, shape (n,)."""
        return self._recorded(np.arange(int(self.duration * rate) + 1) / rate)

    def _sweeps(self, scanner: MountedLidar) -> FloatArray:
        """Return when a scanner could take scans, shape (n,)."""
        last = self.duration - scanner.delay - scanner.sweep
        count = int(np.floor(max(last, 0.0) * scanner.lidar.rate + 1e-9)) + 1
        return self._recorded(np.round(scanner.delay + np.arange(count) / scanner.lidar.rate, 6))

    def _recorded(self, times: FloatArray) -> FloatArray:
        return times if self.pause is None else self.pause.left_out(times)


def pause_with_a_turn(
    motion: Motion, duration: float, seconds: float, rng: np.random.Generator
) -> Pause:
    """Return a pause during which the robot turns, by as much as 90 degrees if it can be.

    Parameters
    ----------
    motion : of the robot.
    duration : of the recording [s].
    seconds : duration of the pause [s].
    rng : the source of where it is, among turns that are nearly as large as the largest.

    Raises
    ------
    ConfigError
        The recording is too short.
    """
    first, last = PAUSE_PART[0] * duration, PAUSE_PART[1] * duration - seconds
    if last <= first:
        raise ConfigError(
            f"simulated pause of {seconds:g} s: the recording of {duration:g} s is too short for "
            "it; give a shorter pause"
        )
    begins = np.arange(first, last, 0.25)
    before, after = (
        np.interp(times, motion.times, motion.poses[:, 2]) for times in (begins, begins + seconds)
    )
    turns = np.abs(after - before)
    turns[turns > LARGEST_PAUSED_TURN + 1e-9] = 0.0
    begin = float(rng.choice(begins[turns >= SHARP * turns.max()]))
    return Pause(begin, begin + seconds)


def spaced(times: FloatArray, motion: Motion, spacing: float) -> FloatArray:
    """Return the first time, and those at which the robot has moved or turned far enough since.

    Parameters
    ----------
    times : float64, shape (n,) [s], increasing.
    motion : of the robot.
    spacing : path length from one scan to the next [m].
    """
    travelled = motion.travelled_at(times).tolist()
    headings = np.interp(times, motion.times, motion.poses[:, 2]).tolist()
    kept = [0]
    for at in range(1, len(times)):
        far = travelled[at] - travelled[kept[-1]] >= spacing
        if far or abs(headings[at] - headings[kept[-1]]) >= TURN_PER_SCAN:
            kept.append(at)
    chosen: FloatArray = times[kept]
    return chosen
