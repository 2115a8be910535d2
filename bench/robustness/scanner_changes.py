# SPDX-License-Identifier: Apache-2.0
"""Changes of what a scanner sees: another kind of scanner, another mounting, parts in its view."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from bench.robustness.carmen_text import CarmenText
from bench.robustness.log_changes import FARTHEST, NEAREST, Apply, Rng
from cartoloop.arrays import FloatArray
from cartoloop.sensor.pose import Pose, compose_all, inverse

OWN_PART_M = 0.3
"""Distance of the robot's own parts from the scanner [m]."""


def beam_angles(log: CarmenText) -> tuple[float, float]:
    """Return the first angle and the step of the beams [rad], as readers infer them."""
    return log.angles or (-0.5 * math.pi, math.radians(round(360.0 / log.num_beams) / 2.0))


def narrow(view: float) -> Apply:
    """Return the change that keeps the beams in the middle, of a smaller field of view [rad]."""

    def apply(log: CarmenText, _: Rng) -> None:
        first, step = beam_angles(log)
        kept = np.flatnonzero(np.abs(first + step * np.arange(log.num_beams)) <= 0.5 * view)
        log.ranges = [None if ranges is None else ranges[kept] for ranges in log.ranges]
        log.angles = (first + step * int(kept[0]), step)

    return apply


def wider_fan(share: float) -> Apply:
    """Return the change whose beams are said to be farther apart than they are, by a share."""

    def apply(log: CarmenText, _: Rng) -> None:
        first, step = beam_angles(log)
        log.angles = ((1.0 + share) * first, (1.0 + share) * step)

    return apply


def rounded(step: float) -> Apply:
    """Return the change that rounds ranges to multiples of a step [m]."""
    return _seen(lambda ranges: step * np.round(ranges / step))


def biased(metres: float) -> Apply:
    """Return the change that makes all ranges longer by the same [m]."""
    return _seen(lambda ranges: ranges + metres)


def own_parts(share: float) -> Apply:
    """Return the change that puts parts of the robot in view, on both sides.

    Parameters
    ----------
    share : of the beams, on each side.
    """

    def apply(log: CarmenText, _: Rng) -> None:
        for ranges in log.ranges:
            if ranges is not None:
                hidden = round(share * len(ranges))
                ranges[:hidden] = OWN_PART_M
                ranges[len(ranges) - hidden :] = OWN_PART_M

    return apply


def bumps(share: float, seconds: float, distance: float) -> Apply:
    """Return the change whose scanner looks at the floor now and then, as over sills.

    Parameters
    ----------
    share : of the time, roughly.
    seconds : that each bump lasts.
    distance : of the floor straight ahead [m].
    """

    def apply(log: CarmenText, rng: Rng) -> None:
        times = log.times
        number = int(share * (times[-1] - times[0]) / seconds)
        begins = np.sort(rng.uniform(times[0], times[-1], number))
        last = np.concatenate(([-math.inf], begins))[np.searchsorted(begins, times)]
        first, step = beam_angles(log)
        ahead = np.cos(first + step * np.arange(log.num_beams))
        floor = distance / np.maximum(ahead, 1e-6)
        for row in np.flatnonzero(times - last < seconds).tolist():
            ranges = log.ranges[row]
            if ranges is not None and len(ranges) == len(floor):
                np.minimum(ranges, floor, out=ranges)

    return apply


def zero_for_none(log: CarmenText, _: Rng) -> None:
    """Write zero for beams without a return."""
    no_return = log.no_return
    for ranges in log.ranges:
        if ranges is not None:
            ranges[ranges >= no_return] = 0.0


def mounted(x: float, y: float, yaw: float) -> Apply:
    """Return the change whose scanner is elsewhere on the robot, which nobody states.

    Parameters
    ----------
    x, y, yaw : pose of the scanner, frame of the robot whose poses are logged [m], [rad].
    """

    def apply(log: CarmenText, _: Rng) -> None:
        tf_scanner_robot = np.array([inverse(Pose(x, y, yaw))])
        log.poses = compose_all(log.poses, np.repeat(tf_scanner_robot, len(log.poses), axis=0))

    return apply


def _seen(change: Callable[[FloatArray], FloatArray]) -> Apply:
    """Return the change that changes the ranges of returns."""

    def apply(log: CarmenText, _: Rng) -> None:
        for ranges in log.ranges:
            if ranges is not None:
                is_return = (ranges > NEAREST) & (ranges < FARTHEST)
                ranges[is_return] = change(ranges[is_return])

    return apply
