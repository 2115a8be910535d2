# SPDX-License-Identifier: Apache-2.0
"""How long a sweep takes, where scans do not say so."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.sensor.events import CloudGeometry, LaserScan, PointCloud, ScanGeometry
from cartoloop.sensor.stated_sweeps import StatedSweeps

GEOMETRY = ScanGeometry(-0.5 * math.pi, math.radians(1.0), 181, 0.1, 30.0)


def scan(geometry=GEOMETRY):
    return LaserScan(5.0, 5.0, np.ones(geometry.num_beams), geometry)


def test_the_last_beam_is_measured_at_the_end_of_the_sweep():
    assert StatedSweeps(0.0067).of(scan()).sweep == pytest.approx((0.0, 0.0067))


def test_scans_of_one_scanner_keep_one_geometry():
    sweeps = StatedSweeps(0.0067)
    one, other = sweeps.of(scan()), sweeps.of(scan())
    assert one.geometry is other.geometry
    assert replace(one.geometry, time_increment=0.0) == GEOMETRY
    many = [replace(GEOMETRY, range_max=30.0 + k) for k in range(200)]
    assert [sweeps.of(scan(each)).geometry.range_max for each in many] == [
        each.range_max for each in many
    ]


@pytest.mark.parametrize(
    "geometry", [replace(GEOMETRY, time_increment=-1e-4), replace(GEOMETRY, num_beams=1)]
)
def test_what_a_scan_states_stays(geometry):
    given = scan(geometry)
    assert StatedSweeps(0.0067).of(given) is given


def test_clouds_and_scans_without_a_stated_sweep_stay():
    given = scan()
    assert StatedSweeps(None).of(given) is given
    cloud = PointCloud(5.0, 5.0, np.zeros((1, 3)), None, CloudGeometry())
    assert StatedSweeps(0.0067).of(cloud) is cloud
