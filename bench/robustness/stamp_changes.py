# SPDX-License-Identifier: Apache-2.0
"""Changes of the stamps of a recording: what verified relations name changes with them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench.robustness.carmen_text import CarmenText
from cartoloop.arrays import FloatArray

NewTimes = Callable[[FloatArray, np.random.Generator], FloatArray]
"""From the times of all readings, in order, and random numbers to new times of each [s]."""

BURST_STEP_S = 0.0005
"""Time between the stamps of messages that arrive together [s]."""

WHOLE_STEP_S = 1e-3
"""Time between stamps of the same second [s]."""

LEAST_STEP_S = 1e-5
"""Least time between two stamps [s]."""


def played_backwards(times: FloatArray, _: np.random.Generator) -> FloatArray:
    """Return the times of readings that are played from the last to the first."""
    played: FloatArray = times[0] + times[-1] - times
    return played


def late_in_bursts(period: float, shortest: float, longest: float) -> NewTimes:
    """Return the times of arrival over a network that is interrupted now and then.

    Parameters
    ----------
    period : mean time between two interruptions [s].
    shortest, longest : of the interruptions [s]; what was sent meanwhile arrives at their end.
    """

    def new_times(times: FloatArray, rng: np.random.Generator) -> FloatArray:
        arrival = times.copy()
        begin = times[0] + rng.exponential(period)
        while begin < times[-1]:
            end = begin + rng.uniform(shortest, longest)
            waiting = np.flatnonzero((times >= begin) & (times < end))
            arrival[waiting] = end + BURST_STEP_S * np.arange(len(waiting))
            begin = end + rng.exponential(period)
        return _in_order(arrival)

    return new_times


def late_at_random(mean: float) -> NewTimes:
    """Return the times of arrival where each message is late by an exponential time, in order.

    Parameters
    ----------
    mean : of the delays [s].
    """

    def new_times(times: FloatArray, rng: np.random.Generator) -> FloatArray:
        return _in_order(times + rng.exponential(mean, len(times)))

    return new_times


def rounded_stamps(times: FloatArray, _: np.random.Generator) -> FloatArray:
    """Return times in whole seconds; those of a second are a millisecond apart: they name scans."""
    seconds = np.floor(times)
    begins, counts = np.unique(seconds, return_index=True, return_counts=True)[1:]
    within = np.arange(len(times)) - np.repeat(begins, counts)
    rounded: FloatArray = seconds + WHOLE_STEP_S * within
    return rounded


def stretched(factor: float) -> NewTimes:
    """Return the times of a robot that is slower by a factor."""

    def new_times(times: FloatArray, _: np.random.Generator) -> FloatArray:
        later: FloatArray = times[0] + factor * (times - times[0])
        return later

    return new_times


def _in_order(times: FloatArray) -> FloatArray:
    """Return times, later where one before it is, and no two equal: stamps name scans."""
    steps = LEAST_STEP_S * np.arange(len(times))
    ordered: FloatArray = np.maximum.accumulate(times - steps) + steps
    return ordered


def renamed(
    stamps: FloatArray, log: CarmenText, new_times: NewTimes, rng: np.random.Generator
) -> FloatArray:
    """Return what stamps of scans are once the readings of a log have others, same shape."""
    scans = np.flatnonzero(log.is_scan)
    old = np.array([float(log.tails[row][-3]) for row in scans.tolist()])
    order = np.argsort(old, kind="stable")
    middles = 0.5 * (old[order][1:] + old[order][:-1])
    renamed: FloatArray = new_times(log.times, rng)[scans[order[np.searchsorted(middles, stamps)]]]
    return renamed


def with_new_times(log: CarmenText, new_times: NewTimes, rng: np.random.Generator) -> None:
    """Give the readings of a log other stamps, and the order of these."""
    times = new_times(log.times, rng)
    order = np.arange(len(times))[:: -1 if times[-1] < times[0] else 1]
    stamps = [f"{time:.6f}" for time in times.tolist()]
    log.poses = log.poses[order]
    log.ranges = [log.ranges[row] for row in order.tolist()]
    log.tails = [
        [*log.tails[row][:-3], stamps[row], log.tails[row][-2], stamps[row]]
        for row in order.tolist()
    ]
