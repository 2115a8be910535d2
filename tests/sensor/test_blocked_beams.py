# SPDX-License-Identifier: Apache-2.0
"""Beams that never have a return clear no floor."""

from __future__ import annotations

import numpy as np

from cartoloop.config import SensorConfig
from cartoloop.sensor.blocked_beams import MIN_SCANS, BlockedBeams
from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.range_filter import RangeFilter

GEOMETRY = ScanGeometry(
    angle_min=-1.0, angle_increment=0.1, num_beams=20, range_min=0.1, range_max=10.0
)


STEP = 0.01


def applied(scans):
    beams = BlockedBeams(len(scans[0]), STEP)
    for ranges in scans:
        last = beams.apply(np.array(ranges), 0.1, 10.0)
    return last


def test_beams_that_never_return_are_blocked():
    last = applied([(1.0, np.inf, 10.0, 0.05)] * MIN_SCANS)
    np.testing.assert_array_equal(last, (1.0, np.nan, np.nan, np.nan))


def test_a_few_scans_do_not_show_it():
    last = applied([(1.0, np.inf, 10.0, 0.05)] * (MIN_SCANS - 1))
    np.testing.assert_array_equal(last, (1.0, np.inf, 10.0, 0.05))


def test_a_beam_that_returned_clears_floor_from_then_on():
    scans = [(1.0, np.inf, np.inf, np.inf)] * MIN_SCANS + [(1.0, 1.2, np.inf, np.inf)]
    last = applied([*scans, (1.0, np.inf, np.inf, np.inf)])
    np.testing.assert_array_equal(last, (1.0, np.inf, np.nan, np.nan))


def test_single_reflections_inside_a_robot_do_not_count():
    blocked = (1.0, np.inf, np.inf, np.inf)
    last = applied([(1.0, 0.3, np.inf, np.inf), *[blocked] * 2 * MIN_SCANS])
    assert np.isnan(last[1])


def test_isolated_returns_show_no_beam_that_sees():
    """Dust and noise in front of a blocked sector; the returns themselves are kept."""
    rng = np.random.default_rng(5)
    scans = np.full((3 * MIN_SCANS, 12), np.inf)
    scans[:, 0] = 9.5
    is_noise = rng.random(scans.shape) < 0.03
    is_noise[:, 0] = False
    scans[is_noise] = rng.uniform(0.2, 8.0, int(is_noise.sum()))
    last = applied([*scans, (9.5, np.inf, 5.0, *[np.inf] * 9)])
    np.testing.assert_array_equal(last, (9.5, np.nan, 5.0, *[np.nan] * 9))


def test_nan_is_no_return():
    last = applied([(1.0, np.nan, np.nan, np.nan)] * MIN_SCANS)
    np.testing.assert_array_equal(last, (1.0, np.nan, np.nan, np.nan))


def test_a_blocked_sector_of_a_scanner_has_no_misses():
    range_filter = RangeFilter(SensorConfig())
    ranges = np.full(20, 3.0)
    ranges[12:] = np.inf
    scans = [LaserScan(t, t, ranges, GEOMETRY) for t in np.arange(0.0, MIN_SCANS)]
    data = [range_filter.apply(scan) for scan in scans]
    assert len(data[0].misses) > 0
    assert len(data[-1].misses) == 0
    assert len(data[-1].returns) == len(data[0].returns) > 0


def test_each_scanner_has_its_own_blocked_beams():
    range_filter = RangeFilter(SensorConfig())
    other = ScanGeometry(
        angle_min=-1.0, angle_increment=0.1, num_beams=20, range_min=0.1, range_max=10.0, sensor="b"
    )
    ranges = np.full(20, np.inf)
    for t in np.arange(0.0, MIN_SCANS):
        range_filter.apply(LaserScan(t, t, ranges, GEOMETRY))
    assert len(range_filter.apply(LaserScan(99.0, 99.0, ranges, GEOMETRY)).misses) == 0
    assert len(range_filter.apply(LaserScan(99.0, 99.0, ranges, other)).misses) > 0
