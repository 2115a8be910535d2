# SPDX-License-Identifier: Apache-2.0
"""The profile of a scanner, estimated from its first scans and again as more arrive."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from threading import Thread

from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.sensor_profile import SensorProfile, profile_sensor

FIRST_SCANS, FIRST_S = 30, 2.0
"""The profile is estimated from this number of scans, or from those of this time [s]."""

FIRST_AGAIN = 100
"""It is estimated again after this number of scans, after twice as many, and so on: the robot may
stand still at the start."""

MAX_GROUPS = 48
"""Groups of scans kept for the estimate: bounds its memory and time."""

GROUP = 3
"""Scans in a group: the noise is estimated from three successive scans."""

_MAX_GEOMETRIES = 256  # of scanners whose beams are never the same twice


class LiveScanner:
    """One scanner: its profile, and the geometry of its scans.

    Parameters
    ----------
    name : its name, empty if it is the only one.
    report : receives the profile, in lines for the user.
    laser_pose : mounting pose; overrides the one in its messages.

    Attributes
    ----------
    profile : None until it is estimated first.
    num_scans : number of scans received.
    """

    def __init__(
        self, name: str, report: Callable[[str], None], laser_pose: Pose | None = None
    ) -> None:
        self.name = name
        self.profile: SensorProfile | None = None
        self.num_scans = 0
        self._report = report
        self._laser_pose = laser_pose
        self._groups: list[list[LaserScan]] = []
        self._every = 1
        self._next_estimate = FIRST_AGAIN
        self._geometries: dict[ScanGeometry, ScanGeometry] = {}
        self._estimating: Thread | None = None

    def see(self, scan: LaserScan) -> None:
        """Add a scan, as sent, to the sample."""
        group, member = divmod(self.num_scans, GROUP)
        self.num_scans += 1
        if group % self._every == 0:
            if member == 0:
                self._groups.append([])
            if self._groups:
                self._groups[-1].append(scan)
        if len(self._groups) > MAX_GROUPS:
            self._groups = self._groups[::2]
            self._every *= 2
        if self.profile is not None and self.num_scans >= self._next_estimate:
            self._next_estimate *= 2
            self._estimate_again()

    def read_profile(self) -> None:
        """Estimate the profile from the scans so far, and report it."""
        self.profile = profile_sensor(self._sample())
        name = f" {self.name}" if self.name else ""
        self._report(f"scanner{name}, by its first {self.num_scans} scans:")
        for line in self.profile.describe().splitlines()[:-1]:
            self._report(line)

    def geometry_of(self, sent: ScanGeometry) -> ScanGeometry:
        """Return the geometry of a scan with the limits of the profile."""
        geometry = self._geometries.get(sent)
        if geometry is None:
            geometry = sent if self.profile is None else self._limited(sent, self.profile)
            if self._laser_pose is not None:
                geometry = replace(geometry, tf_tracking_sensor=self._laser_pose)
            if len(self._geometries) >= _MAX_GEOMETRIES:
                self._geometries.clear()
            self._geometries[sent] = geometry
        return geometry

    @staticmethod
    def _limited(sent: ScanGeometry, profile: SensorProfile) -> ScanGeometry:
        geometry = profile.apply(sent)
        if sent.no_return_is_free:
            return geometry
        # Ranges beyond range_max are no measurements, but for this scanner's no-return value.
        value = profile.no_return
        is_sign = value is not None and math.isfinite(value) and value > 0.0
        return replace(geometry, no_return_is_free=is_sign)

    def wait(self) -> None:
        """Wait until no estimate is running."""
        if self._estimating is not None:
            self._estimating.join()

    def _sample(self) -> list[LaserScan]:
        return [scan for group in self._groups for scan in group]

    def _estimate_again(self) -> None:
        """Estimate the profile again, in a thread, so that no scan waits."""
        if self._estimating is not None and self._estimating.is_alive():
            return
        self._estimating = Thread(
            target=self._adopt, args=(self._sample(),), name="profile", daemon=True
        )
        self._estimating.start()

    def _adopt(self, scans: list[LaserScan]) -> None:
        before, now = self.profile, profile_sensor(scans)
        assert before is not None
        limits = (before.range_min, before.range_max), (now.range_min, now.range_max)
        if limits[0] == limits[1]:
            return
        self.profile = now
        self._geometries = {}
        if _differ(before.range_max, now.range_max):
            end = f"{now.range_max:.2f} m" if math.isfinite(now.range_max) else "no limit seen"
            name = f" {self.name}" if self.name else ""
            self._report(
                f"scanner{name}, after {self.num_scans} scans: ranges "
                f"{now.range_min:.2f} m to {end}"
            )


def _differ(one: float, other: float) -> bool:
    return not math.isclose(one, other, rel_tol=0.01)
