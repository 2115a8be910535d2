# SPDX-License-Identifier: Apache-2.0
"""Faults of what a scanner sees: hidden, mixed or drifting ranges."""

from __future__ import annotations

import numpy as np

from bench.robustness.carmen_text import CarmenText
from bench.robustness.log_changes import FARTHEST, NEAREST, Apply, Rng
from bench.robustness.people import BODY_M, CLOTHES_M
from bench.robustness.scanner_changes import beam_angles

EDGE_M = 0.5
"""Ranges of neighbours that differ by more are at an edge [m]."""

COMPANION_M, COMPANION_SWAY_M, COMPANION_SWAY_RATE = 1.2, 0.2, 0.7
"""Mean distance of a person who walks with the robot [m], and how the distance changes [m],
[rad/s]."""


def mixed_pixels(share: float) -> Apply:
    """Return the change whose beams hit the edges of objects and what is behind, too.

    Parameters
    ----------
    share : of the edges whose nearer beam measures a range in between.
    """

    def apply(log: CarmenText, rng: Rng) -> None:
        for ranges in log.ranges:
            if ranges is None:
                continue
            here, there = ranges[:-1], ranges[1:]
            is_return = (np.minimum(here, there) > NEAREST) & (np.maximum(here, there) < FARTHEST)
            edges = np.flatnonzero(is_return & (np.abs(here - there) > EDGE_M))
            edges = edges[rng.random(len(edges)) < share]
            mixed = ranges[edges] + rng.random(len(edges)) * (ranges[edges + 1] - ranges[edges])
            ranges[np.where(ranges[edges] < ranges[edges + 1], edges, edges + 1)] = mixed

    return apply


def blinded(share: float, seconds: float, sector: float) -> Apply:
    """Return the change in which the sun blinds a sector of the scanner now and then.

    Parameters
    ----------
    share : of the time, roughly.
    seconds : that the sun shines in.
    sector : without returns meanwhile [rad].
    """

    def apply(log: CarmenText, rng: Rng) -> None:
        times = log.times
        number = int(share * (times[-1] - times[0]) / seconds)
        begins = np.sort(rng.uniform(times[0], times[-1], number))
        spell = np.searchsorted(begins, times, side="right")
        since = times - np.concatenate(([-np.inf], begins))[spell]
        first, step = beam_angles(log)
        bearings = first + step * np.arange(log.num_beams)
        middles = rng.uniform(bearings[0], bearings[-1], number + 1)
        no_return = log.no_return
        for row in np.flatnonzero(since < seconds).tolist():
            ranges = log.ranges[row]
            if ranges is not None and len(ranges) == len(bearings):
                ranges[np.abs(bearings - middles[spell[row]]) < 0.5 * sector] = no_return

    return apply


def companion(bearing: float) -> Apply:
    """Return the change in which a person walks with the robot for the whole recording.

    Parameters
    ----------
    bearing : at which the person walks [rad].
    """

    def apply(log: CarmenText, rng: Rng) -> None:
        seconds = log.times - log.times[0]
        first, step = beam_angles(log)
        bearings = first + step * np.arange(log.num_beams)
        distances = COMPANION_M + COMPANION_SWAY_M * np.sin(COMPANION_SWAY_RATE * seconds)
        for ranges, distance in zip(log.ranges, distances.tolist(), strict=True):
            if ranges is None or len(ranges) != len(bearings):
                continue
            hidden = np.abs(bearings - bearing) < 0.5 * BODY_M / distance
            seen = distance + rng.normal(0.0, CLOTHES_M, np.count_nonzero(hidden))
            ranges[hidden] = np.minimum(ranges[hidden], seen)

    return apply


def warming(metres: float) -> Apply:
    """Return the change whose ranges get longer while the scanner gets warm [m], until half-way."""

    def apply(log: CarmenText, _: Rng) -> None:
        times = log.times
        passed = np.minimum(2.0 * (times - times[0]) / (times[-1] - times[0]), 1.0)
        for ranges, share in zip(log.ranges, passed.tolist(), strict=True):
            if ranges is not None:
                ranges[(ranges > NEAREST) & (ranges < FARTHEST)] += metres * share

    return apply
