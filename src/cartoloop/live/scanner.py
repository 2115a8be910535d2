# SPDX-License-Identifier: Apache-2.0
"""What a scanner turns out to be, read off its first scans and again as more are seen."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from threading import Thread

from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.sensor_profile import SensorProfile, profile_sensor

FIRST_SCANS, FIRST_S = 30, 2.0
"""A scanner is read off its first scans: so many, or those of so long [s]."""

FIRST_AGAIN = 100
"""And again after so many scans, twice as many, and so on: at the start the robot may stand."""

MAX_GROUPS = 48
GROUP = 3  # successive scans tell the noise

_MAX_GEOMETRIES = 256  # of scanners whose beams are never the same twice


class LiveScanner:
    """One scanner: its profile, and the geometry of its scans.

    Parameters
    ----------
    name : its name, empty if there is one alone.
    tell : receives what it turned out to be, in lines for the user.
    laser_pose : where it sits, whatever it says.

    Attributes
    ----------
    profile : None as long as nothing is known.
    num_scans : how many it sent.
    """

    def __init__(
        self, name: str, tell: Callable[[str], None], laser_pose: Pose | None = None
    ) -> None:
        self.name = name
        self.profile: SensorProfile | None = None
        self.num_scans = 0
        self._tell = tell
        self._laser_pose = laser_pose
        self._groups: list[list[LaserScan]] = []
        self._every = 1
        self._next_look = FIRST_AGAIN
        self._geometries: dict[ScanGeometry, ScanGeometry] = {}
        self._looking: Thread | None = None

    def see(self, scan: LaserScan) -> None:
        """Take a scan, as sent, into account."""
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
        if self.profile is not None and self.num_scans >= self._next_look:
            self._next_look *= 2
            self._look_again()

    def read_profile(self) -> None:
        """Read the profile off the scans so far, and tell it."""
        self.profile = profile_sensor(self._sample())
        name = f" {self.name}" if self.name else ""
        self._tell(f"scanner{name}, by its first {self.num_scans} scans:")
        for line in self.profile.describe().splitlines()[:-1]:
            self._tell(line)

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
        # Numbers beyond the end say nothing, unless they are this scanner's sign for no return.
        value = profile.no_return
        is_sign = value is not None and math.isfinite(value) and value > 0.0
        return replace(geometry, no_return_is_free=is_sign)

    def wait(self) -> None:
        """Wait until it is not being looked at."""
        if self._looking is not None:
            self._looking.join()

    def _sample(self) -> list[LaserScan]:
        return [scan for group in self._groups for scan in group]

    def _look_again(self) -> None:
        """Read the profile anew, in a thread: no scan waits for that."""
        if self._looking is not None and self._looking.is_alive():
            return
        self._looking = Thread(
            target=self._adopt, args=(self._sample(),), name="profile", daemon=True
        )
        self._looking.start()

    def _adopt(self, scans: list[LaserScan]) -> None:
        before, now = self.profile, profile_sensor(scans)
        assert before is not None
        limits = (before.range_min, before.range_max), (now.range_min, now.range_max)
        if limits[0] == limits[1]:
            return
        self.profile = now
        self._geometries = {}
        if _differ(before.range_max, now.range_max):
            end = f"{now.range_max:.2f} m" if math.isfinite(now.range_max) else "no end seen"
            name = f" {self.name}" if self.name else ""
            self._tell(
                f"scanner{name}, after {self.num_scans} scans: ranges "
                f"{now.range_min:.2f} m to {end}"
            )


def _differ(one: float, other: float) -> bool:
    return not math.isclose(one, other, rel_tol=0.01)
