# SPDX-License-Identifier: Apache-2.0
"""The range that a scanner sends for a beam without a return, estimated from the ranges.

Scanners send their maximum (50, 81.91 m), a value jittering about it, infinity or 0. The finite
value appears as a peak at the upper end of the histogram. A long wall is a peak as well while the
robot stands still, so a peak is accepted only if it is seen from several places, or if it has a
shape that no wall has.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray

TOP_SHARE = 0.9
"""Share of the largest range above which a peak may be the no-return value."""

PEAK_WIDTH = 0.002
"""Half the width of a peak, as a share of its range: 0.1 m at 50 m."""

MARGIN = 0.005
"""Distance below a peak that jitter reaches, as a share of its range."""

MIN_CONTRAST, MIN_PEAK_RANGES = 20.0, 5
"""Least density of a peak over the density below it, and least number of its ranges."""

BAND_START = 0.8
"""Start of the band below a peak with which it is compared, as a share of its range."""

MIN_PLACES, MIN_PLACE_SHARE = 3, 0.1
"""Least number of places from which a peak is seen; and share of all places, where the peak is not
at least `FAR_FACTOR` times as far as all else."""

FAR_FACTOR = 2.0
"""Ratio of a peak to the next range from which on `MIN_PLACES` are enough."""

SECOND_SHARE = 0.05
"""Least size of a second peak, as a share of the main peak."""

PLACE_CHANGE = 0.1
"""Median change of the ranges between two places [m]: far more than noise."""

MIN_ARC = math.radians(15.0)
"""Angle over which a flat wall does not have a constant range [rad]."""

MIN_GAP_FACTOR = 4.0
"""Ratio of the farthest wall to the next one that does not occur."""

MIN_RANGE_MAX = 3.0
"""Shortest maximum range of a scanner [m]."""

MIN_SHARE_SPECIAL = 1e-3
"""Least share of zeros for 0 to be the no-return value."""


class NoReturn(NamedTuple):
    """The value sent for no return [m] or None; its share of beams; where measurements end [m]."""

    value: float | None
    share: float
    range_max: float


def find_no_return(ranges: FloatArray, angle_increment: float) -> NoReturn:
    """Return the value that a scanner sends for no return.

    Parameters
    ----------
    ranges : float64, shape (num_scans, num_beams), as recorded, in the order of time.
    angle_increment : from one beam to the next [rad].

    Notes
    -----
    Never raises. `range_max` lies 0.5% below the peak, since some scanners jitter about it;
    it is inf where no peak is found.
    """
    total = max(ranges.size, 1)
    num_infinite = int(np.isposinf(ranges).sum())
    num_zero = int((ranges == 0.0).sum())
    peak = _find_peak(ranges, abs(angle_increment))
    if peak is None:
        if num_infinite:
            return NoReturn(math.inf, num_infinite / total, math.inf)
        if num_zero >= MIN_SHARE_SPECIAL * total:
            return NoReturn(0.0, num_zero / total, math.inf)
        return NoReturn(None, 0.0, math.inf)
    low, value = peak
    range_max = (1.0 - MARGIN) * low
    num_at_peak = int((np.isfinite(ranges) & (ranges >= range_max)).sum())
    if num_infinite > num_at_peak:
        return NoReturn(math.inf, (num_infinite + num_at_peak) / total, range_max)
    return NoReturn(value, (num_at_peak + num_infinite) / total, range_max)


def _find_peak(ranges: FloatArray, step: float) -> tuple[float, float] | None:
    """Return the lower end of the peaks at the top and the main one's value, or None."""
    places = _distinct_places(ranges)
    several = len(places) >= MIN_PLACES
    used = places if several else ranges
    values = np.sort(used[np.isfinite(used) & (used > 0.0)])
    if len(values) == 0:
        return None
    top = values[values >= TOP_SHARE * values[-1]]
    main = _densest(top)
    if main < MIN_RANGE_MAX or not _stands_out(values, main):
        return None
    if several:
        if not _is_seen_widely(places, values, main):
            return None
    elif not _is_no_wall(ranges, values, main, step):
        return None
    return _lowest_peak(values, main), main


def _distinct_places(ranges: FloatArray) -> FloatArray:
    """Return one scan for each place that looks different from the place before."""
    kept: list[int] = []
    for i in range(len(ranges)):
        if kept:
            both = np.isfinite(ranges[i]) & np.isfinite(ranges[kept[-1]])
            change = np.abs(ranges[i][both] - ranges[kept[-1]][both])
            if len(change) == 0 or median(change) < PLACE_CHANGE:
                continue
        kept.append(i)
    return ranges[kept]


def median(values: FloatArray) -> float:
    """Return the median of some finite numbers, ten times as fast as NumPy for few."""
    ordered = np.sort(values)
    last = len(ordered) - 1
    return float(0.5 * (ordered[last // 2] + ordered[(last + 1) // 2]))


def _densest(top: FloatArray) -> float:
    """Return the most frequent value in the densest part of a sorted array."""
    half = PEAK_WIDTH * top[-1]
    inside = np.searchsorted(top, top + half, "right") - np.searchsorted(top, top - half, "left")
    centre = top[np.argmax(inside)]
    distinct, counts = np.unique(top[np.abs(top - centre) <= half], return_counts=True)
    return float(distinct[np.argmax(counts)])


def _count(values: FloatArray, low: float, high: float) -> int:
    return int(np.searchsorted(values, high, "right") - np.searchsorted(values, low, "left"))


def _stands_out(values: FloatArray, peak: float) -> bool:
    """Return whether ranges are far denser at a peak than in the band below it."""
    inside = _count(values, (1.0 - PEAK_WIDTH) * peak, (1.0 + PEAK_WIDTH) * peak)
    low, high = BAND_START * peak, (1.0 - 3.0 * MARGIN) * peak
    expected = _count(values, low, high) * 2.0 * PEAK_WIDTH * peak / (high - low)
    return inside >= MIN_PEAK_RANGES and inside >= MIN_CONTRAST * expected


def _is_seen_widely(places: FloatArray, values: FloatArray, peak: float) -> bool:
    """Return whether a peak is seen from more places than one wall is."""
    num_seen = int((np.abs(places - peak) <= PEAK_WIDTH * peak).any(axis=1).sum())
    nearer = values[values < (1.0 - 3.0 * MARGIN) * peak]
    is_far = len(nearer) == 0 or peak >= FAR_FACTOR * nearer[-1]
    required = MIN_PLACES if is_far else max(MIN_PLACES, math.ceil(MIN_PLACE_SHARE * len(places)))
    return num_seen >= required


def _is_no_wall(ranges: FloatArray, values: FloatArray, peak: float, step: float) -> bool:
    """Return whether a peak, seen from one place, has a shape that no wall has."""
    nearer = values[values < (1.0 - 3.0 * MARGIN) * peak]
    if len(nearer) and peak >= MIN_GAP_FACTOR * nearer[-1]:
        return True
    at_peak = np.abs(ranges - peak) <= PEAK_WIDTH * peak
    return _longest_run(at_peak) * step >= MIN_ARC


def _longest_run(mask: BoolArray) -> int:
    """Return the largest number of successive true values in a row of `mask`."""
    length = np.zeros(len(mask), dtype=np.int64)
    longest = 0
    for column in mask.T:
        length = np.where(column, length + 1, 0)
        longest = max(longest, int(length.max(initial=0)))
    return longest


def _lowest_peak(values: FloatArray, main: float) -> float:
    """Return the lower end [m] of the peaks at the top; some scanners have two."""
    num_main = _count(values, (1.0 - PEAK_WIDTH) * main, (1.0 + PEAK_WIDTH) * main)
    lowest = main
    below = values[(values >= TOP_SHARE * main) & (values < (1.0 - 2.0 * PEAK_WIDTH) * main)]
    if len(below):
        second = _densest(below)
        inside = _count(values, (1.0 - PEAK_WIDTH) * second, (1.0 + PEAK_WIDTH) * second)
        if inside >= SECOND_SHARE * num_main and _stands_out(values, second):
            lowest = second
    return lowest
