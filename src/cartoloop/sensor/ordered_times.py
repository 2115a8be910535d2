# SPDX-License-Identifier: Apache-2.0
"""Times in order: repeated and late ones spread, those out of order left out or raised."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np

from cartoloop.arrays import FloatArray, IntArray

DELAY_STEPS, BURST_SHARE = 2.0, 0.25
"""A step longer than the first number of usual ones is a delay if steps follow that are shorter
than the second share of a usual one."""

BATCH_STEP = 0.02
"""Stamps that are usually closer together than this [s], and than `BURST_SHARE` of the mean step
between their batches, were given where messages are fetched now and then, many at once."""

REGULAR, REGULAR_SHARE = 0.5, 0.4
"""Of stamps of regular messages, at least the second share of the steps deviates by less than the
first share from the usual one: others are of scans that were recorded after some distance each."""


def late_bursts(stamps: FloatArray) -> list[tuple[int, int]]:
    """Return the bursts of stamps that were all given at the end of a delay, as first and last row.

    Messages that wait for a network or a busy computer arrive together; stamps of their arrival
    are late by up to the delay.

    Parameters
    ----------
    stamps : float64, shape (n,) [s].
    """
    steps = np.diff(stamps)
    usual = _usual_step(steps)
    if usual == 0.0:
        return []
    is_short = (steps >= 0.0) & (steps < BURST_SHARE * usual)
    ends = np.append(np.flatnonzero(~is_short), len(steps))  # the steps that end a burst
    found = []
    for delay in np.flatnonzero(steps > DELAY_STEPS * usual).tolist():
        last = int(ends[np.searchsorted(ends, delay, side="right")])
        if last > delay + 1:
            found.append((delay + 1, last))
    return found


def _usual_step(steps: FloatArray) -> float:
    """Return the usual step between messages [s], also where most of them come in batches; or 0."""
    forwards = steps[steps > 0.0]
    if len(forwards) == 0:
        return 0.0
    usual = float(np.median(forwards))
    between = forwards[forwards >= BATCH_STEP]
    if usual < BATCH_STEP and len(between):
        mean = float(np.median(between)) * len(between) / len(steps)
        if usual < BURST_SHARE * mean:
            return mean
    return usual


def spread_late(stamps: FloatArray) -> FloatArray:
    """Return times for regular stamps in order, late bursts spread over the delay before them.

    They are taken to be a usual step apart, the last a step before the stamp after them, or in time
    if that is later; they are closer together where the delay is too short.
    """
    times = stamps.copy()
    bursts = late_bursts(stamps)
    if not bursts:
        return times
    steps = np.diff(stamps)
    usual = _usual_step(steps)
    if np.mean(np.abs(steps - usual) < REGULAR * usual) < REGULAR_SHARE:
        return times
    for first, last in bursts:
        number = last + 1 - first
        before, after = stamps[first - 1], stamps[last + 1] if last + 1 < len(stamps) else np.inf
        end = min(stamps[last] + usual, after)
        spacing = min(usual, (end - before) / (number + 1))
        times[first : last + 1] = end - spacing * np.arange(number, 0, -1)
    return times


def spread_repeats(stamps: FloatArray, period: float) -> FloatArray:
    """Return increasing times for stamps in order, equal ones spread towards the next.

    Parameters
    ----------
    stamps : float64, shape (n,), none smaller than the one before [s].
    period : the widest spacing among equal stamps [s].
    """
    firsts = np.flatnonzero(np.concatenate(([True], np.diff(stamps) > 0.0)))[: len(stamps)]
    if len(firsts) == len(stamps):
        return stamps.copy()
    counts = np.diff(np.append(firsts, len(stamps)))
    values = stamps[firsts]
    room = np.append(np.diff(values), np.inf) / counts
    rank = np.arange(len(stamps)) - np.repeat(firsts, counts)
    spacing = np.minimum(room, period)
    spread: FloatArray = stamps + rank * np.repeat(spacing, counts)
    return strictly_increasing(spread)


def longest_ordered(values: FloatArray) -> IntArray:
    """Return the indices of a longest subsequence that never decreases. O(n log n)."""
    tails: list[float] = []
    tail_indices: list[int] = []
    previous = np.full(len(values), -1, dtype=np.int64)
    for i, value in enumerate(values.tolist()):
        length = bisect_right(tails, value)
        if length == len(tails):
            tails.append(value)
            tail_indices.append(i)
        else:
            tails[length] = value
            tail_indices[length] = i
        previous[i] = tail_indices[length - 1] if length else -1
    chain = []
    i = tail_indices[-1] if tail_indices else -1
    while i >= 0:
        chain.append(i)
        i = int(previous[i])
    return np.array(chain[::-1], dtype=np.int64)


def strictly_increasing(times: FloatArray) -> FloatArray:
    """Return the times, raised as little as possible where they do not increase."""
    if len(times) < 2 or (np.diff(times) > 0.0).all():
        return times
    # A ramp of a few rounding errors keeps the running maximum from being flat.
    tiny = 4.0 * np.spacing(np.abs(times).max())
    ramp = tiny * np.arange(len(times))
    reached = np.maximum.accumulate(times - ramp)
    lifted: FloatArray = np.where(reached > times - ramp, reached + ramp, times)
    return lifted
