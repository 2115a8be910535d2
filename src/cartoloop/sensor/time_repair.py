# SPDX-License-Identifier: Apache-2.0
"""Strictly increasing times from the stamps of a recording.

The order of the file is taken to be correct. Stamps may be late (in bursts, which may run
backwards), equal, missing, outliers ("wild"), or on a clock that was reset. All functions are pure.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.sensor.median import median, quantile
from cartoloop.sensor.ordered_times import (
    late_bursts,
    longest_ordered,
    spread_late,
    spread_repeats,
    strictly_increasing,
)

NOMINAL_PERIOD = 0.2
"""Period of a log without any stamps [s]: the usual scanner of such logs sends at 5 Hz."""

MIN_JUMP, JUMP_PERIODS = 10.0, 20.0
"""Minimum length of a jump [s], [periods], the larger of both: shorter steps are delays."""

WILD_AT_THE_END = 3600.0
"""A first or last stamp that deviates by more is wild even if it is in order [s]."""

LATEST_STAMP = 1e11
"""Stamps beyond it, or before the negative of it, are no times [s]: the year 5138."""

AGREEING_STAMPS = 5
"""Number of neighbours on either side; a stamp is compared with their median."""

BURSTY_SHARE, LATE_SHARE, BURSTY_COUNT = 0.01, 0.02, 10
"""Share of backward steps or of late bursts, and number of either, that make a section bursty: its
stamps are then averaged."""

BLOCK_SCANS = 100
"""Number of scans over which bursty stamps are averaged."""

GAP_PERIODS, SHOWN_BY = 5.0, 30
"""A step of the first number of periods within bursty stamps may be a gap: it is one if three
quarters of this number of stamps after it are later by as much than those before it."""

SAME_SHIFT_S = 1e-9
"""Shifts of two scans closer than this are equal but for rounding [s]."""


@dataclass(frozen=True, slots=True)
class TimeReport:
    """The faults of the stamps of a recording.

    Attributes
    ----------
    num_stamps : number of stamps.
    num_missing : number of lines without a stamp.
    num_backwards : steps to an earlier stamp; `largest_backwards` [s] is the longest of them.
    num_repeated : steps to an equal stamp.
    num_late : stamps that were given in a burst at the end of a delay.
    num_wild : single stamps far from their neighbours.
    num_repaired : number of times that differ from their stamps.
    period : typical time from one stamp to the next [s].
    gaps, gap_lengths : indices of the stamps after real gaps, and their lengths [s].
    resets : indices of the first stamps after resets of the clock.
    """

    num_stamps: int
    num_missing: int = 0
    num_backwards: int = 0
    largest_backwards: float = 0.0
    num_repeated: int = 0
    num_late: int = 0
    num_wild: int = 0
    num_repaired: int = 0
    period: float = NOMINAL_PERIOD
    gaps: tuple[int, ...] = ()
    gap_lengths: tuple[float, ...] = ()
    resets: tuple[int, ...] = ()

    @property
    def is_sound(self) -> bool:
        """Whether every time is its stamp."""
        return self.num_repaired == 0

    def describe(self) -> str:
        """Return one line for the user."""
        parts = []
        if self.num_missing:
            parts.append(f"{self.num_missing} missing")
        if self.num_backwards:
            parts.append(
                f"{self.num_backwards} run backwards (by up to {self.largest_backwards:.3g} s)"
            )
        if self.num_repeated:
            parts.append(f"{self.num_repeated} repeated")
        if self.num_late:
            parts.append(f"{self.num_late} given late, in bursts")
        if self.num_wild:
            parts.append(f"{self.num_wild} wild")
        if self.resets:
            parts.append(f"the clock is reset {len(self.resets)} times")
        if self.gaps:
            parts.append(f"{len(self.gaps)} gaps (up to {max(self.gap_lengths):.4g} s)")
        if not parts:
            return f"{self.num_stamps} stamps, all in order"
        return f"{self.num_stamps} stamps: " + ", ".join(parts)


def repair_times(
    stamps: FloatArray, nominal_period: float = NOMINAL_PERIOD
) -> tuple[FloatArray, TimeReport]:
    """Return strictly increasing times for `stamps`, and the faults of these.

    Parameters
    ----------
    stamps : float64, shape (n,), in the true order; NaN where missing [s].
    nominal_period : time between scans, if there is no stamp [s].

    Returns
    -------
    times : float64, shape (n,) [s]. The stamps where these are in order. Sections between gaps are
        repaired separately. In a bursty section the times follow a polyline through the medians
        of blocks of 100 stamps. In other sections the largest set of stamps in order is kept, late
        ones spread over the delay before them, and the others are interpolated.
    report : the faults.

    Notes
    -----
    Never raises. O(n log n).
    """
    stamps = np.asarray(stamps, dtype=np.float64)
    num = len(stamps)
    present = np.abs(stamps) <= LATEST_STAMP
    clean = stamps[present]
    steps = np.diff(clean)
    backwards = steps[steps < 0.0]
    period = _typical_period(clean, np.flatnonzero(present), nominal_period)
    wild = _find_wild(clean, period)
    kept = np.flatnonzero(present)[~wild]
    kept_times, gaps, resets = _repair_in_sections(stamps[kept], period)
    times = strictly_increasing(_fill(kept, kept_times, num, period))
    num_finite = int(np.isfinite(stamps).sum())
    report = TimeReport(
        num_stamps=num,
        num_missing=num - num_finite,
        num_backwards=len(backwards),
        largest_backwards=float(-backwards.min()) if len(backwards) else 0.0,
        num_repeated=int((steps == 0.0).sum()),
        num_late=sum(last + 1 - first for first, last in late_bursts(clean)),
        num_wild=int(wild.sum()) + num_finite - len(clean),
        num_repaired=int((times != stamps).sum()),
        period=period,
        gaps=tuple(int(kept[i]) for i in gaps),
        gap_lengths=tuple(gaps.values()),
        resets=tuple(int(kept[i]) for i in resets),
    )
    return times, report


def run_backwards(stamps: FloatArray) -> bool:
    """Return whether stamps run backwards often: lines were written late, in bursts."""
    backwards = int((np.diff(stamps) < 0.0).sum())
    return backwards >= max(BURSTY_COUNT, BURSTY_SHARE * len(stamps))


def are_bursty(stamps: FloatArray) -> bool:
    """Return whether stamps run backwards, or are given late and together, often."""
    late = max(BURSTY_COUNT, LATE_SHARE * len(stamps))
    return run_backwards(stamps) or len(late_bursts(stamps)) >= late


def jump_length(period: float) -> float:
    """Return the minimum length of a jump between stamps [s], given the typical step."""
    return max(MIN_JUMP, JUMP_PERIODS * period)


def _typical_period(stamps: FloatArray, places: IntArray, nominal_period: float) -> float:
    """Return the mean step without jumps [s]; the median would be too small for bursts."""
    steps = np.diff(stamps) / np.diff(places)  # stamps may be missing in between
    moving = np.abs(steps[steps != 0.0])
    if len(moving) == 0:
        return nominal_period
    usual = float(np.median(moving))
    small = np.abs(steps) <= jump_length(usual)
    mean = float(np.diff(stamps)[small].sum() / max(np.diff(places)[small].sum(), 1))
    return mean if mean > 0.0 else usual


def _find_wild(stamps: FloatArray, period: float) -> BoolArray:
    """Return which stamps are far from the median of their neighbours, and out of order."""
    half = min(AGREEING_STAMPS, len(stamps) - 1)
    limit = jump_length(period)
    if half < 1 or not (np.abs(np.diff(stamps)) > limit).any():
        return np.zeros(len(stamps), dtype=np.bool_)
    around = sliding_window_view(np.pad(stamps, half, mode="reflect"), 2 * half + 1)
    off = np.abs(stamps - np.median(around, axis=1))
    lows = np.pad(stamps, half, constant_values=-np.inf)
    highs = np.pad(stamps, half, constant_values=np.inf)
    earlier = sliding_window_view(lows, half)[: len(stamps)].max(axis=1)
    later = sliding_window_view(highs, half)[half + 1 :].min(axis=1)
    # First and last stamps may be wild although in order; the limit is large since gaps occur.
    at_end = np.ones(len(stamps), dtype=np.bool_)
    at_end[half:-half] = False
    wild: BoolArray = (off > limit) & ((earlier > stamps) | (later < stamps))
    return wild | (at_end & (off > WILD_AT_THE_END))


def _repair_in_sections(
    stamps: FloatArray, period: float
) -> tuple[FloatArray, dict[int, float], list[int]]:
    """Return times, index and length of gaps, indices of resets; no stamp is wild or NaN."""
    limit = jump_length(period)
    steps = np.diff(stamps)
    cuts = np.flatnonzero(np.abs(steps) > limit) + 1
    times = np.empty_like(stamps)
    gaps: dict[int, float] = {}
    resets: list[int] = []
    shift, previous_end = 0.0, -np.inf
    for start, stop in zip((0, *cuts), (*cuts, len(stamps)), strict=True):
        if start == stop:
            continue
        section = _repair_section(stamps[start:stop], period)
        if start > 0:
            # A clock that returns to its former time needs no shift.
            fitting = [s for s in (0.0, shift) if section[0] + s > previous_end]
            shift = fitting[0] if fitting else previous_end + period - section[0]
            if not fitting:
                resets.append(int(start))
            elif section[0] + shift - previous_end > limit:
                gaps[int(start)] = float(section[0] + shift - previous_end)
        times[start:stop] = section + shift
        previous_end = float(times[stop - 1])
    return times, gaps, resets


def _repair_section(stamps: FloatArray, period: float) -> FloatArray:
    """Return increasing times for stamps without long jumps."""
    if are_bursty(stamps):
        ends = [0, *_lasting_gaps(stamps, period), len(stamps)]
        return strictly_increasing(
            np.concatenate([_even_times(stamps[start:end]) for start, end in pairwise(ends)])
        )
    if not (np.diff(stamps) < 0.0).any():
        return spread_repeats(spread_late(stamps), period)
    kept = longest_ordered(stamps)
    in_order = spread_repeats(spread_late(stamps[kept]), period)
    times = _fill(kept, in_order, len(stamps), period)
    return strictly_increasing(times)


def _lasting_gaps(stamps: FloatArray, period: float) -> list[int]:
    """Return the indices of the stamps after gaps that are no delays, in order.

    After a delay, stamps come in a burst until they have caught up.
    """
    limit = GAP_PERIODS * period
    late = stamps - period * np.arange(len(stamps))
    gaps: list[int] = []
    for after in (np.flatnonzero(np.diff(stamps) > limit) + 1).tolist():
        first = max(after - SHOWN_BY, gaps[-1] if gaps else 0)
        shift = quantile(late[after : after + SHOWN_BY], 0.25) - median(late[first:after])
        if min(after - first, len(stamps) - after) >= SHOWN_BY and shift > limit:
            gaps.append(after)
    return gaps


def _even_times(stamps: FloatArray) -> FloatArray:
    """Return times along a polyline through the medians of blocks of stamps."""
    index = np.arange(len(stamps), dtype=np.float64)
    blocks = np.array_split(np.arange(len(stamps)), max(1, len(stamps) // BLOCK_SCANS))
    slope = (stamps[-1] - stamps[0]) / (len(stamps) - 1)
    if len(blocks) > 1:
        first, last = blocks[0], blocks[-1]
        rise = np.median(stamps[last]) - np.median(stamps[first])
        slope = rise / (last.mean() - first.mean())
    residuals = stamps - slope * index
    medians = [median(residuals[block]) for block in blocks]
    centres = [float(block.mean()) for block in blocks]
    even: FloatArray = slope * index + np.interp(index, centres, medians)
    return even


def _fill(kept: IntArray, kept_times: FloatArray, num: int, period: float) -> FloatArray:
    """Return times for all `num` places: the given ones, and between them evenly spread ones."""
    if len(kept) == num:
        return kept_times.copy()
    index = np.arange(num)
    if len(kept) == 0:
        return period * np.arange(num, dtype=np.float64)
    after = np.searchsorted(kept, index, side="right")
    left = np.clip(after - 1, 0, len(kept) - 1)
    right = np.clip(after, 0, len(kept) - 1)
    # Missing scans at a gap belong to one side of it.
    room = (kept_times[right] - kept_times[left]) / np.maximum(kept[right] - kept[left], 1)
    spacing = np.where((right == left) | (room > JUMP_PERIODS * period), period, room)
    filled: FloatArray = kept_times[left] + (index - kept[left]) * spacing
    return filled


def times_between(
    stamps: FloatArray,
    places: IntArray,
    anchor_stamps: FloatArray,
    anchor_times: FloatArray,
    anchor_places: IntArray,
) -> FloatArray:
    """Return times of events between anchors (odometry between scans) that keep the file's order.

    Parameters
    ----------
    stamps : float64, shape (n,); NaN where missing [s].
    places : int64, shape (n,), increasing; positions of the events in the file.
    anchor_stamps, anchor_times : float64, shape (m,), m > 0; the scans' stamps and times [s].
    anchor_places : int64, shape (m,), increasing; positions of the scans in the file.

    Returns
    -------
    float64, shape (n,) [s], non-decreasing, none after the next scan. The stamp, shifted like those
    of the scans around it, where it is in order and both scans have the same shift; the time of
    the scan where the stamps are equal; otherwise interpolated between the scans.
    """
    before = np.searchsorted(anchor_places, places) - 1
    left = np.maximum(before, 0)
    right = np.minimum(before + 1, len(anchor_places) - 1)
    shift_left = (anchor_times - anchor_stamps)[left]
    shift_right = (anchor_times - anchor_stamps)[right]
    low = np.where(before >= 0, anchor_times[left], -np.inf)
    high = np.where(before + 1 < len(anchor_places), anchor_times[right], np.inf)
    sound = (shift_left == shift_right) | (np.abs(shift_left - shift_right) < SAME_SHIFT_S)
    own = stamps + np.where(before >= 0, shift_left, shift_right)
    own = np.where(sound, own, np.nan)
    own = np.where(stamps == anchor_stamps[left], anchor_times[left], own)
    own = np.where(stamps == anchor_stamps[right], anchor_times[right], own)
    # Before the first and after the last scan there is only one neighbour to compare with.
    loose = ~(np.isfinite(low) & np.isfinite(high))
    nearest = np.where(before >= 0, anchor_times[left], anchor_times[right])
    own = np.where(loose & ~(np.abs(own - nearest) <= WILD_AT_THE_END), np.nan, own)
    times = np.clip(own, low, high)
    in_order = np.isfinite(times)
    in_order[1:] &= (np.diff(times) >= 0.0) | (np.diff(before) != 0)
    for start, stop in _runs(before):
        if not in_order[start:stop].all():
            times[start:stop] = _in_order(times[start:stop], low[start], high[start])
    return times


def _runs(groups: IntArray) -> list[tuple[int, int]]:
    """Return start and end of each run of equal values."""
    cuts = np.flatnonzero(np.diff(groups)) + 1
    edges = [0, *cuts.tolist(), len(groups)]
    return [(a, b) for a, b in pairwise(edges) if a < b]


def _in_order(times: FloatArray, low: float, high: float) -> FloatArray:
    """Return the times between two scans, those out of order or NaN spread among the others."""
    finite = np.flatnonzero(np.isfinite(times))
    kept = finite[longest_ordered(times[finite])]
    places = [-1.0, *kept.tolist(), float(len(times))]
    values = [low, *times[kept].tolist(), high]
    known = [(p, v) for p, v in zip(places, values, strict=True) if np.isfinite(v)]
    filled: FloatArray = np.interp(
        np.arange(len(times)), [p for p, _ in known], [v for _, v in known]
    )
    return filled
