# SPDX-License-Identifier: Apache-2.0
"""Sweeps of scanners whose recordings do not say how long they take.

A scanner that measures its beams one after the other while the robot turns sees each turn too small
by the rate of the robot over its own, whichever way it turns: the map bends to one side.
"""

from __future__ import annotations

from dataclasses import replace

from cartoloop.sensor.events import LaserScan, PointCloud, ScanGeometry

_MAX_GEOMETRIES = 64
"""Sources that make an object for each scan must not fill the memory."""


class StatedSweeps:
    """States how long a sweep takes, where a scan does not.

    Parameters
    ----------
    sweep : from the first beam to the last [s]; None: scans are left as they are.
    """

    def __init__(self, sweep: float | None) -> None:
        self._sweep = sweep
        self._geometries: dict[int, tuple[ScanGeometry, ScanGeometry]] = {}

    def of(self, scan: LaserScan | PointCloud) -> LaserScan | PointCloud:
        """Return a scan with the times of its beams."""
        if self._sweep is None or isinstance(scan, PointCloud):
            return scan
        geometry = scan.geometry
        if geometry.time_increment != 0.0 or geometry.num_beams < 2:
            return scan
        known = self._geometries.get(id(geometry))
        if known is None:
            if len(self._geometries) >= _MAX_GEOMETRIES:
                self._geometries.clear()
            stated = replace(geometry, time_increment=self._sweep / (geometry.num_beams - 1))
            # The geometry is kept as well, so that no other one gets its identity.
            known = self._geometries[id(geometry)] = geometry, stated
        return replace(scan, geometry=known[1])
