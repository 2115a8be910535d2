# SPDX-License-Identifier: Apache-2.0
"""What is changed in a log: scans and beams left out, noise, other odometry, other clocks."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from bench.robustness.carmen_text import CarmenText
from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.sensor.pose import compose_all, relative_all

Rng = np.random.Generator
Apply = Callable[[CarmenText, Rng], None]

NEAREST, FARTHEST = 0.05, 40.0
"""Ranges between these are returns [m], to which noise is added."""

AFTER_START_S = 30.0
"""Nothing is lost before this time [s]: a map has begun."""


def drop_every(count: int) -> Apply:
    """Return the change that leaves out every n-th scan."""

    def apply(log: CarmenText, _: Rng) -> None:
        is_scan = log.is_scan
        log.keep(~is_scan | (np.cumsum(is_scan) % count != 0))

    return apply


def one_scan_in(count: int) -> Apply:
    """Return the change that keeps every n-th scan; odometry alone is left."""

    def apply(log: CarmenText, _: Rng) -> None:
        is_scan = log.is_scan
        log.keep(~is_scan | (np.cumsum(is_scan) % count == 0))

    return apply


def sparse(spacing: float, turn: float) -> Apply:
    """Return the change that leaves a scan after each length [m] or turn [rad] of the odometry."""

    def apply(log: CarmenText, _: Rng) -> None:
        last = None
        for row in np.flatnonzero(log.is_scan).tolist():
            pose = log.poses[row]
            if last is not None:
                x, y, theta = (pose - last).tolist()
                if math.hypot(x, y) < spacing and abs(math.remainder(theta, math.tau)) < turn:
                    log.ranges[row] = None
                    log.tails[row] = ["0", "0", "0", *log.tails[row]]  # speeds, as ODOM has them
                    continue
            last = pose

    return apply


def noise(sigma: float) -> Apply:
    """Return the change that adds normal noise to each return [m]."""

    def apply(log: CarmenText, rng: Rng) -> None:
        for ranges in log.ranges:
            if ranges is not None:
                seen = (ranges > NEAREST) & (ranges < FARTHEST)
                ranges[seen] += rng.normal(0, sigma, int(seen.sum()))

    return apply


def noise_share(share: float) -> Apply:
    """Return the change that adds normal noise that is a share of each range."""

    def apply(log: CarmenText, rng: Rng) -> None:
        no_return = log.no_return
        for ranges in log.ranges:
            if ranges is not None:
                seen = (ranges > NEAREST) & (ranges < no_return)
                ranges[seen] *= 1.0 + rng.normal(0, share, int(seen.sum()))

    return apply


def pauses(period: float, seconds: float) -> Apply:
    """Return the change that leaves out all readings of some seconds of each period [s]."""

    def apply(log: CarmenText, _: Rng) -> None:
        times = log.times
        log.keep((times - times[0]) % period > seconds)

    return apply


def lost_scans(share: float, seconds: float) -> Apply:
    """Return the change that leaves out the scans of some seconds in turn, at random times.

    Readings of odometry alone are left.

    Parameters
    ----------
    share : of the duration that is left out, roughly.
    seconds : that each gap lasts.
    """

    def apply(log: CarmenText, rng: Rng) -> None:
        log.keep(~_at_random(log.times, share, seconds, rng) | ~log.is_scan)

    return apply


def frozen(share: float, seconds: float) -> Apply:
    """Return the change whose odometry misses the motion of some seconds in turn, at random times.

    Parameters are those of :func:`lost_scans`.
    """

    def apply(log: CarmenText, rng: Rng) -> None:
        is_missed = _at_random(log.times, share, seconds, rng)[1:, np.newaxis]
        odometry_steps(lambda steps: np.where(is_missed, 0.0, steps))(log, rng)

    return apply


def _at_random(times: FloatArray, share: float, seconds: float, rng: Rng) -> BoolArray:
    """Return which times are in one of the stretches of some seconds."""
    number = int(share * (times[-1] - times[0]) / seconds)
    begins = np.sort(rng.uniform(times[0] + AFTER_START_S, times[-1], number))
    last = np.concatenate(([-math.inf], begins))[np.searchsorted(begins, times)]
    is_within: BoolArray = times - last < seconds
    return is_within


def twice(log: CarmenText, _: Rng) -> None:
    """Hold each line twice, as two recorders at once write it."""
    rows = np.repeat(np.arange(len(log.ranges)), 2)
    log.poses = log.poses[rows]
    log.ranges = [None if (ranges := log.ranges[row]) is None else ranges.copy() for row in rows]
    log.tails = [list(log.tails[row]) for row in rows]


def held(share: float, seconds: float) -> Apply:
    """Return the change that repeats a scan for some seconds, after a share of the scans."""

    def apply(log: CarmenText, rng: Rng) -> None:
        times, until, last = log.times, -math.inf, None
        for row in np.flatnonzero(log.is_scan).tolist():
            ranges = log.ranges[row]
            if times[row] < until and last is not None:
                log.ranges[row] = last.copy()
                continue
            last = ranges
            if rng.random() < share:
                until = times[row] + seconds

    return apply


def seldom_read(period: float) -> Apply:
    """Return the change that reads the odometry once in a period [s], and repeats it until then."""

    def apply(log: CarmenText, _: Rng) -> None:
        read, row_read, rows = -math.inf, 0, []
        for row, time in enumerate(log.times.tolist()):
            if time - read >= period:
                read, row_read = time, row
            rows.append(row_read)
        log.poses = log.poses[rows]

    return apply


def reverse_beams(log: CarmenText, _: Rng) -> None:
    """Send the beams in the other order, as of a scanner that is mounted upside down.

    An even number of beams begins on the right and ends one step before the left: there is none
    that is straight on the left once they are mirrored.
    """
    no_return = log.no_return

    def reversed_beams(ranges: FloatArray) -> FloatArray:
        if len(ranges) % 2:
            return ranges[::-1]
        return np.append(no_return, ranges[:0:-1])

    log.ranges = [None if ranges is None else reversed_beams(ranges) for ranges in log.ranges]


def slanting(change: float) -> Apply:
    """Return the change that leaves beams without a return where ranges change much.

    Parameters
    ----------
    change : from beam to beam, as a share of the range: walls seen at a slant, and edges.
    """

    def apply(log: CarmenText, _: Rng) -> None:
        no_return = log.no_return
        for ranges in log.ranges:
            if ranges is not None:
                ranges[np.abs(np.gradient(ranges)) > change * ranges] = no_return

    return apply


def start(seconds: float) -> Apply:
    """Return the change that leaves out the beginning [s]."""

    def apply(log: CarmenText, _: Rng) -> None:
        log.keep(log.times >= log.times[0] + seconds)

    return apply


def end(seconds: float) -> Apply:
    """Return the change that leaves out the end [s]."""

    def apply(log: CarmenText, _: Rng) -> None:
        log.keep(log.times <= log.times[-1] - seconds)

    return apply


def mirror(log: CarmenText, _: Rng) -> None:
    """Exchange left and right."""
    log.poses = log.poses * (1.0, -1.0, -1.0)
    log.ranges = [None if ranges is None else ranges[::-1] for ranges in log.ranges]


def odometry_steps(change: Callable[[FloatArray], FloatArray]) -> Apply:
    """Return the change that changes the steps of the odometry, shape (n, 3)."""

    def apply(log: CarmenText, _: Rng) -> None:
        steps = change(relative_all(log.poses[:-1], log.poses[1:]))
        headings = log.poses[0, 2] + np.concatenate(([0.0], np.cumsum(steps[:, 2])))
        turned = np.column_stack((np.zeros((len(steps), 2)), headings[:-1]))
        moved = np.cumsum(compose_all(turned, steps)[:, :2], axis=0)
        places = log.poses[0, :2] + np.vstack((np.zeros((1, 2)), moved))
        log.poses = np.column_stack((places, headings))

    return apply


def longer(share: float) -> Callable[[FloatArray], FloatArray]:
    """Return what makes steps longer by a share."""
    return lambda steps: steps * (1.0 + share, 1.0 + share, 1.0)


def multiplied(factor: float) -> Callable[[FloatArray], FloatArray]:
    """Return what multiplies steps and turns, as a wrong gear ratio does."""
    return lambda steps: steps * factor


def drifting(radians_a_metre: float) -> Callable[[FloatArray], FloatArray]:
    """Return what makes steps turn to the left [rad/m]."""

    def change(steps: FloatArray) -> FloatArray:
        turns = radians_a_metre * np.hypot(steps[:, 0], steps[:, 1])
        return np.column_stack((steps[:, :2], steps[:, 2] + turns))

    return change


def newer_odometry(seconds: float) -> Apply:
    """Return the change that takes the odometry from a later time [s]."""

    def apply(log: CarmenText, _: Rng) -> None:
        log.poses = odometry_at(log, log.times + seconds)

    return apply


def jittering_odometry(sigma: float) -> Apply:
    """Return the change that takes the odometry from times with normal errors [s]."""

    def apply(log: CarmenText, rng: Rng) -> None:
        log.poses = odometry_at(log, log.times + rng.normal(0.0, sigma, len(log.poses)))

    return apply


def odometry_at(log: CarmenText, times: FloatArray) -> FloatArray:
    """Return the odometry at some times, interpolated, shape (n, 3)."""
    known = log.times + np.arange(len(log.poses)) * 1e-7  # so that all differ
    columns = (log.poses[:, 0], log.poses[:, 1], np.unwrap(log.poses[:, 2]))
    return np.column_stack([np.interp(times, known, column) for column in columns])


def noisy_odometry(share: float, radians_a_metre: float) -> Apply:
    """Return the change that makes the odometry's steps noisy.

    Parameters
    ----------
    share : standard deviation of the lengths and turns of its steps, as a share of them.
    radians_a_metre : standard deviation of the heading after a metre.
    """

    def apply(log: CarmenText, rng: Rng) -> None:
        def change(steps: FloatArray) -> FloatArray:
            count, noisy = len(steps), steps.copy()
            noisy[:, :2] *= 1.0 + rng.normal(0.0, share, (count, 1))
            noisy[:, 2] *= 1.0 + rng.normal(0.0, share, count)
            lengths = np.hypot(steps[:, 0], steps[:, 1])
            noisy[:, 2] += rng.normal(0.0, radians_a_metre, count) * np.sqrt(lengths)
            return noisy

        odometry_steps(change)(log, rng)

    return apply


def short_sighted(reach: float) -> Apply:
    """Return the change that leaves out returns from farther than the scanner reaches [m]."""

    def apply(log: CarmenText, _: Rng) -> None:
        no_return = log.no_return
        for ranges in log.ranges:
            if ranges is not None:
                ranges[ranges > reach] = no_return

    return apply


def thinned(every: int) -> Apply:
    """Return the change that keeps one in n beams."""

    def apply(log: CarmenText, _: Rng) -> None:
        step = math.radians(round(180.0 / log.num_beams * 2.0) / 2.0)
        log.angles = (-math.pi / 2, every * step)
        log.ranges = [None if ranges is None else ranges[::every] for ranges in log.ranges]

    return apply


def missing(share: float) -> Apply:
    """Return the change that leaves beams without a return, at random."""

    def apply(log: CarmenText, rng: Rng) -> None:
        no_return = log.no_return
        for ranges in log.ranges:
            if ranges is not None:
                ranges[rng.random(len(ranges)) < share] = no_return

    return apply


def longer_ranges(share: float) -> Apply:
    """Return the change that makes ranges longer by a share."""

    def apply(log: CarmenText, _: Rng) -> None:
        for ranges in log.ranges:
            if ranges is not None:
                seen: BoolArray = (ranges > NEAREST) & (ranges < FARTHEST)
                ranges[seen] *= 1.0 + share

    return apply


def blocked(first: float, width: float) -> Apply:
    """Return the change that leaves the beams of a sector without a return.

    Parameters
    ----------
    first, width : where it begins and how wide it is, as shares of the field of view.
    """

    def apply(log: CarmenText, _: Rng) -> None:
        no_return = log.no_return
        for ranges in log.ranges:
            if ranges is not None:
                count = len(ranges)
                ranges[round(first * count) : round((first + width) * count)] = no_return

    return apply


def outliers(share: float) -> Apply:
    """Return the change that gives beams any range up to eight metres, at random."""

    def apply(log: CarmenText, rng: Rng) -> None:
        for ranges in log.ranges:
            if ranges is not None:
                is_wrong = rng.random(len(ranges)) < share
                ranges[is_wrong] = rng.uniform(0.2, 8.0, int(is_wrong.sum()))

    return apply
