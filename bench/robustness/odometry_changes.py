# SPDX-License-Identifier: Apache-2.0
"""Changes of the odometry: turns, rounding, bursts, clocks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench.robustness.carmen_text import CarmenText
from bench.robustness.log_changes import (
    Apply,
    Rng,
    odometry_at,
    odometry_steps,
    seldom_read,
)
from cartoloop.arrays import FloatArray
from cartoloop.sensor.pose import compose_all, relative_all

FAR_ORIGIN = (412_000.0, 5_650_000.0, 2.0)
"""Pose of an odometry frame in that of a survey, as UTM is [m], [rad]."""


def turning_more(share: float) -> Callable[[FloatArray], FloatArray]:
    """Return what makes turns larger by a share, as a wrong track width does."""
    return lambda steps: steps * (1.0, 1.0, 1.0 + share)


def coarse_odometry(length: float, turn: float, period: float) -> Apply:
    """Return the change that reads rounded odometry seldom.

    Parameters
    ----------
    length, turn : what its poses are multiples of [m], [rad].
    period : between readings [s]; each is repeated until the next.
    """

    def apply(log: CarmenText, rng: Rng) -> None:
        seldom_read(period)(log, rng)
        units = np.array([length, length, turn])
        log.poses = units * np.round(log.poses / units)

    return apply


def turning_in_bursts(rate: float, share: float, seconds: float) -> Apply:
    """Return the change whose odometry also turns by itself for some seconds, at random times.

    Parameters
    ----------
    rate : of the turns [rad/s], to either side.
    share : of the duration, roughly.
    seconds : that each burst lasts.
    """

    def apply(log: CarmenText, rng: Rng) -> None:
        times = log.times
        number = int(share * (times[-1] - times[0]) / seconds)
        begins = np.sort(rng.uniform(times[0], times[-1], number))
        sides = rng.choice((-1.0, 1.0), number + 1)
        begun = np.searchsorted(begins, times[1:])
        last = np.concatenate(([-np.inf], begins))[begun]
        turns = np.where(times[1:] - last < seconds, rate * sides[begun] * np.diff(times), 0.0)
        added = np.column_stack((np.zeros((len(turns), 2)), turns))
        odometry_steps(lambda steps: steps + added)(log, rng)

    return apply


def skidding_turns(share: float, seconds: float) -> Apply:
    """Return the change whose turns are larger or smaller by up to a share, as of skid steering.

    Parameters
    ----------
    share : of the turns, at most.
    seconds : after these, they are so by another share.
    """

    def apply(log: CarmenText, rng: Rng) -> None:
        times = log.times
        stretch = ((times[1:] - times[0]) / seconds).astype(np.int64)
        factors = rng.uniform(1.0 - share, 1.0 + share, int(stretch.max()) + 1)[stretch]
        ones = np.ones_like(factors)
        odometry_steps(lambda steps: steps * np.column_stack((ones, ones, factors)))(log, rng)

    return apply


def drifting_clock(rate: float) -> Apply:
    """Return the change whose odometry has a clock of its own, which is fast by a share."""

    def apply(log: CarmenText, _: Rng) -> None:
        times = log.times
        log.poses = odometry_at(log, times + rate * (times - times[0]))

    return apply


def restarted(seconds: float) -> Apply:
    """Return the change whose odometry begins at zero again after a gap in the middle [s]."""

    def apply(log: CarmenText, _: Rng) -> None:
        times = log.times
        middle = 0.5 * (times[0] + times[-1])
        log.keep((times <= middle) | (times > middle + seconds))
        second = log.times > middle
        if second.any():
            later = log.poses[second]
            log.poses[second] = relative_all(np.repeat(later[:1], len(later), axis=0), later)

    return apply


def far_origin(log: CarmenText, _: Rng) -> None:
    """Report poses in a frame whose origin is far away, as that of a survey."""
    tf_survey_odometry = np.array([FAR_ORIGIN])
    log.poses = compose_all(np.repeat(tf_survey_odometry, len(log.poses), axis=0), log.poses)


def no_motion(log: CarmenText, _: Rng) -> None:
    """Report zeros, as logs of scanners without a robot do."""
    log.poses = np.zeros_like(log.poses)


def left_handed(log: CarmenText, _: Rng) -> None:
    """Report poses with y to the right, and turns to the right as positive."""
    log.poses = log.poses * (1.0, -1.0, -1.0)


def second_half(log: CarmenText, _: Rng) -> None:
    """Leave out the first half."""
    times = log.times
    log.keep(times >= 0.5 * (times[0] + times[-1]))
