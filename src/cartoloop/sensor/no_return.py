# SPDX-License-Identifier: Apache-2.0
"""Which range a scanner sends when a beam meets nothing, found from the ranges themselves.

Scanners send their maximum (50, 81.91 m), a value jittering about it, infinity or 0. The finite
value shows as a pile-up at the upper end of the histogram. A long wall piles up there as well
while the robot stands still, so a pile-up counts only if it is seen from several places, or if it
has a shape that no wall has.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

TOP_SHARE = 0.9  # a pile-up above this part of the largest range may be the no-return value
PILE_WIDTH = 0.002  # half its width, relative: 0.1 m at 50 m
MARGIN = 0.005  # jitter reaches so far below it, relative
MIN_CONTRAST = 20.0  # how many times denser than the ranges below it
MIN_PLACES = 3
MIN_PLACE_SHARE = 0.1  # of all places, where no wide gap tells the pile-up from a wall
SECOND_SHARE = 0.05  # of the main pile-up, for a second one to count
PLACE_CHANGE = 0.1  # median change of the ranges between two places [m]
MIN_ARC = math.radians(15.0)  # a flat wall is nowhere equally far over such an angle
MIN_GAP_FACTOR = 4.0  # nor is the farthest wall so much farther than the next
MIN_RANGE_MAX = 3.0  # no scanner ends nearer [m]
MIN_SHARE_SPECIAL = 1e-3  # of zeros, for 0 to be the value


class NoReturn(NamedTuple):
    """The value sent for no return [m] or None; its share of beams; where measurements end [m]."""

    value: float | None
    share: float
    range_max: float


def find_no_return(ranges: FloatArray, angle_increment: float) -> NoReturn:
    """Return the value that stands for no return.

    Parameters
    ----------
    ranges : float64, shape (num_scans, num_beams), as recorded, in the order of time.
    angle_increment : from one beam to the next [rad].

    Notes
    -----
    Never raises. `range_max` lies 0.5% below the pile-up, since some scanners jitter about it;
    it is inf where no pile-up is found.
    """
    total = max(ranges.size, 1)
    num_infinite = int(np.isposinf(ranges).sum())
    num_zero = int((ranges == 0.0).sum())
    pile = _find_pile(ranges, abs(angle_increment))
    if pile is None:
        if num_infinite:
            return NoReturn(math.inf, num_infinite / total, math.inf)
        if num_zero >= MIN_SHARE_SPECIAL * total:
            return NoReturn(0.0, num_zero / total, math.inf)
        return NoReturn(None, 0.0, math.inf)
    low, value = pile
    range_max = (1.0 - MARGIN) * low
    num_piled = int((np.isfinite(ranges) & (ranges >= range_max)).sum())
    if num_infinite > num_piled:
        return NoReturn(math.inf, (num_infinite + num_piled) / total, range_max)
    return NoReturn(value, (num_piled + num_infinite) / total, range_max)


def _find_pile(ranges: FloatArray, step: float) -> tuple[float, float] | None:
    """Return the lower end of the pile-ups at the top and the main one's value, or None."""
    places = _distinct_places(ranges)
    several = len(places) >= MIN_PLACES
    looked_at = places if several else ranges
    values = np.sort(looked_at[np.isfinite(looked_at) & (looked_at > 0.0)])
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
    return _lowest_pile(values, main), main


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
    """Return the median of some finite numbers, in a tenth of the time that NumPy takes for few."""
    ordered = np.sort(values)
    last = len(ordered) - 1
    return float(0.5 * (ordered[last // 2] + ordered[(last + 1) // 2]))


def _densest(top: FloatArray) -> float:
    """Return the most frequent value in the densest part of a sorted array."""
    half = PILE_WIDTH * top[-1]
    inside = np.searchsorted(top, top + half, "right") - np.searchsorted(top, top - half, "left")
    centre = top[np.argmax(inside)]
    distinct, counts = np.unique(top[np.abs(top - centre) <= half], return_counts=True)
    return float(distinct[np.argmax(counts)])


def _count(values: FloatArray, low: float, high: float) -> int:
    return int(np.searchsorted(values, high, "right") - np.searchsorted(values, low, "left"))


def _stands_out(values: FloatArray, pile: float) -> bool:
    """Return whether ranges are far denser at `pile` than in the band below it."""
    inside = _count(values, (1.0 - PILE_WIDTH) * pile, (1.0 + PILE_WIDTH) * pile)
    low, high = 0.8 * pile, (1.0 - 3.0 * MARGIN) * pile
    expected = _count(values, low, high) * 2.0 * PILE_WIDTH * pile / (high - low)
    return inside >= 5 and inside >= MIN_CONTRAST * expected


def _is_seen_widely(places: FloatArray, values: FloatArray, pile: float) -> bool:
    """Return whether the pile-up is seen from more places than the same wall ever is."""
    num_seen = int((np.abs(places - pile) <= PILE_WIDTH * pile).any(axis=1).sum())
    nearer = values[values < (1.0 - 3.0 * MARGIN) * pile]
    far_off = len(nearer) == 0 or pile >= 2.0 * nearer[-1]
    wanted = MIN_PLACES if far_off else max(MIN_PLACES, math.ceil(MIN_PLACE_SHARE * len(places)))
    return num_seen >= wanted


def _is_no_wall(ranges: FloatArray, values: FloatArray, pile: float, step: float) -> bool:
    """Return whether the pile-up, seen from one place, has a shape that no wall has."""
    nearer = values[values < (1.0 - 3.0 * MARGIN) * pile]
    if len(nearer) and pile >= MIN_GAP_FACTOR * nearer[-1]:
        return True
    at_pile = np.abs(ranges - pile) <= PILE_WIDTH * pile
    return _longest_run(at_pile) * step >= MIN_ARC


def _longest_run(mask: BoolArray) -> int:
    """Return the largest number of successive true values in a row of `mask`."""
    length = np.zeros(len(mask), dtype=np.int64)
    longest = 0
    for column in mask.T:
        length = np.where(column, length + 1, 0)
        longest = max(longest, int(length.max(initial=0)))
    return longest


def _lowest_pile(values: FloatArray, main: float) -> float:
    """Return the lower end [m] of the pile-ups at the top, of which some scanners have two."""
    num_main = _count(values, (1.0 - PILE_WIDTH) * main, (1.0 + PILE_WIDTH) * main)
    lowest = main
    below = values[(values >= TOP_SHARE * main) & (values < (1.0 - 2.0 * PILE_WIDTH) * main)]
    if len(below):
        second = _densest(below)
        inside = _count(values, (1.0 - PILE_WIDTH) * second, (1.0 + PILE_WIDTH) * second)
        if inside >= SECOND_SHARE * num_main and _stands_out(values, second):
            lowest = second
    return lowest
