# SPDX-License-Identifier: Apache-2.0
"""Whether two scans of a robot are explained better by a motion between them than by none.

Around a robot at rest, people change many of the ranges; what else it sees stays where it is. If
the robot moves, even along a corridor, much fits from another place only. Narrow objects that stand
free, which may be people, are not compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.kernels.changed_ranges import any_changed
from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.free_standing import are_free_standing
from cartoloop.sensor.range_noise import Noise

CHANGE_M, CHANGE_SHARE, CHANGE_SIGMAS = 0.05, 0.03, 4.0
"""A range has changed if it has by more than the first [m], this share of it, and this number of
standard deviations of a noisy scanner."""

FARTHEST_M, SPACING_M = 1.0, 0.1
"""Motions that are tried, forwards, backwards and to both sides: up to the first, by the second."""

MIN_SEEN = 0.5
"""Least share of the returns that must be in the view of the other scan."""


@dataclass(frozen=True)
class SeenScan:
    """A scan that others are compared with, and which of its ranges are comparable."""

    scan: LaserScan

    @property
    def is_return(self) -> BoolArray:
        """Which ranges are returns, shape (n,)."""
        scan = self.scan
        is_return: BoolArray = (scan.ranges > 0.0) & (scan.ranges < scan.geometry.range_max)
        return is_return

    @cached_property
    def is_comparable(self) -> BoolArray:
        """Which ranges are returns, and not of narrow objects that stand free, shape (n,)."""
        chosen = self.is_return
        chosen[chosen] = ~are_free_standing(_points(self.scan, chosen))
        return chosen

    def differs(self, other: SeenScan, noise: Noise) -> bool:
        """Return whether any return has changed; mostly none has, where a robot rests."""
        before, now = self.scan, other.scan
        return any_changed(
            before.ranges,
            now.ranges,
            float(before.geometry.range_max),
            float(now.geometry.range_max),
            (CHANGE_M, CHANGE_SHARE, CHANGE_SIGMAS),
            noise[:],
        )


def have_changed(before: FloatArray, now: FloatArray, noise: Noise) -> BoolArray:
    """Return which ranges differ by more than their noise.

    Parameters
    ----------
    before, now : float64, same shape [m].
    """
    nearer = np.minimum(before, now)
    changed: BoolArray = np.abs(now - before) > (
        CHANGE_M + CHANGE_SHARE * nearer + CHANGE_SIGMAS * noise.at(nearer)
    )
    return changed


class Explained(NamedTuple):
    """The shares of a scan's returns that fit an earlier scan.

    A motion is compared with rest by the returns that the earlier scan could see after either.

    Attributes
    ----------
    by_rest : if the robot did not move.
    by_expected : after the motion that was expected of it.
    by_motion : after the best of many motions; not less than either.
    """

    by_rest: float
    by_expected: float
    by_motion: float


ALL_BY_REST = Explained(1.0, 0.0, 1.0)
"""Where nothing is known."""


def explained(
    seen_before: SeenScan, seen_now: SeenScan, noise: Noise, velocity: tuple[float, float]
) -> Explained:
    """Return how much of a scan fits an earlier one: without a motion, and after motions.

    Parameters
    ----------
    noise : of the scanner.
    velocity : that is expected of the robot, along x and y of the tracking frame [m/s].
    """
    before, now, is_return = seen_before.scan, seen_now.scan, seen_now.is_comparable
    count = int(np.count_nonzero(is_return))
    if count == 0 or before.geometry.angle_increment == 0.0:
        return ALL_BY_REST
    motions = _motions(before, now.time - before.time, velocity)
    moved = _points(now, is_return) + motions[:, np.newaxis]
    beam = _beams(before, np.arctan2(moved[..., 1], moved[..., 0]))
    rows = np.clip(beam, 0, len(before.ranges) - 1)
    is_seen = (beam == rows) & seen_before.is_comparable[rows]
    fits = is_seen & ~have_changed(before.ranges[rows], np.hypot(*np.moveaxis(moved, 2, 0)), noise)
    num_seen = np.maximum(is_seen.sum(axis=1), MIN_SEEN * count)
    by_rest = float(fits[0].sum() / num_seen[0])
    # Of the same returns: that some leave the view speaks for no motion.
    is_both = is_seen & is_seen[0]
    gains = ((is_both & fits).sum(axis=1) - (is_both & fits[0]).sum(axis=1)) / num_seen
    return Explained(by_rest, by_rest + float(gains[1]), by_rest + float(gains.max()))


def _motions(scan: LaserScan, seconds: float, velocity: tuple[float, float]) -> FloatArray:
    """Return the motions that are tried, in the scanner's frame: none, the expected one, others."""
    steps: FloatArray = np.arange(SPACING_M, FARTHEST_M + 0.5 * SPACING_M, SPACING_M)
    both = np.concatenate((-steps, steps))
    none = np.zeros_like(both)
    along, across = np.column_stack((both, none)), np.column_stack((none, both))
    yaw = scan.geometry.tf_tracking_sensor.theta
    cos, sin = np.cos(yaw), np.sin(yaw)
    x, y = velocity[0] * seconds, velocity[1] * seconds
    expected = (cos * x + sin * y, cos * y - sin * x)
    return np.concatenate((((0.0, 0.0), expected), along, across))


def _points(scan: LaserScan, chosen: BoolArray) -> FloatArray:
    """Return the ends of the chosen beams, frame of the scanner [m]."""
    points: FloatArray = scan.ranges[chosen][:, np.newaxis] * _directions(scan.geometry)[chosen]
    return points


@lru_cache(maxsize=8)
def _directions(geometry: ScanGeometry) -> FloatArray:
    """Return the unit vectors of all beams, frame of the scanner."""
    angles = geometry.angles
    return np.column_stack((np.cos(angles), np.sin(angles)))


def _beams(scan: LaserScan, bearings: FloatArray) -> IntArray:
    """Return the beams of a scan that are nearest to bearings [rad], beyond its ends, too."""
    geometry = scan.geometry
    middle = geometry.angle_min + 0.5 * geometry.angle_increment * (len(scan.ranges) - 1)
    from_middle = np.remainder(bearings - middle + np.pi, 2.0 * np.pi) - np.pi
    beams = np.rint((from_middle + middle - geometry.angle_min) / geometry.angle_increment)
    rows: IntArray = beams.astype(np.int64)
    return rows
