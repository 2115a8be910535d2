# SPDX-License-Identifier: Apache-2.0
"""Statistics and checks of the clouds of a 3D scanner. One function per check."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

from cartoloop.doctor.findings import Finding, first_of
from cartoloop.sensor.events import PointCloud

MIN_POINTS = 50
"""Points below which a cloud cannot be matched: ten returns in each of five rings."""

LONGEST_SWEEP_S = 0.5
"""Longest plausible sweep [s]: scanners rotate at 5 Hz or faster."""


@dataclass(slots=True)
class CloudWatch:
    """Statistics of the clouds of a scanner; memory grows by two numbers per cloud.

    Attributes
    ----------
    name : of the scanner.
    stamps, times : of each cloud [s].
    num_points : total.
    num_poor, first_poor : clouds with too few points; stamp of the first.
    num_untimed : clouds whose points have no times.
    num_odd, first_odd : clouds with points measured before the stamp, or long after it.
    sweep : longest time from the stamp to a point [s].
    """

    name: str
    stamps: array[float] = field(default_factory=lambda: array("d"))
    times: array[float] = field(default_factory=lambda: array("d"))
    num_points: int = 0
    num_poor: int = 0
    first_poor: float | None = None
    num_untimed: int = 0
    num_odd: int = 0
    first_odd: float | None = None
    sweep: float = 0.0

    @property
    def count(self) -> int:
        """Number of clouds."""
        return len(self.stamps)

    def add(self, cloud: PointCloud) -> None:
        """Add a cloud."""
        self.stamps.append(cloud.stamp)
        self.times.append(cloud.time)
        self.num_points += len(cloud.points)
        if len(cloud.points) < MIN_POINTS:
            self.num_poor += 1
            self.first_poor = first_of(self.first_poor, cloud.stamp)
        if cloud.times is None or len(cloud.times) == 0:
            self.num_untimed += 1
            return
        first, last = float(cloud.times.min()), float(cloud.times.max())
        self.sweep = max(self.sweep, last)
        if first < 0.0 or last > LONGEST_SWEEP_S:
            self.num_odd += 1
            self.first_odd = first_of(self.first_odd, cloud.stamp)


def check_clouds(watch: CloudWatch) -> list[Finding]:
    """Return the problems of a scanner's clouds."""
    found = (check_points(watch), check_point_times(watch), check_untimed(watch))
    return [finding for finding in found if finding is not None]


def check_points(watch: CloudWatch) -> Finding | None:
    """Clouds with very few points."""
    if not watch.num_poor:
        return None
    every = watch.num_poor == watch.count
    return Finding(
        "error" if every else "warning",
        "no_returns" if every else "few_returns",
        f"{watch.num_poor} of {watch.count} clouds have fewer than {MIN_POINTS} points",
        "check the scanner and the filters of its clouds",
        watch.name,
        watch.num_poor,
        watch.first_poor,
    )


def check_point_times(watch: CloudWatch) -> Finding | None:
    """Points that were not measured between the stamp of their cloud and the next."""
    if not watch.num_odd:
        return None
    return Finding(
        "warning",
        "point_times",
        f"in {watch.num_odd} clouds points are measured before the stamp, or more than "
        f"{LONGEST_SWEEP_S} s after it",
        "let the driver stamp the first point, and give each point its time since then",
        watch.name,
        watch.num_odd,
        watch.first_odd,
    )


def check_untimed(watch: CloudWatch) -> Finding | None:
    """Clouds whose points have no times."""
    if not watch.num_untimed:
        return None
    return Finding(
        "info",
        "no_point_times",
        f"the points of {watch.num_untimed} clouds have no times",
        "the clouds cannot be deskewed; record the driver's field of times",
        watch.name,
        watch.num_untimed,
    )
