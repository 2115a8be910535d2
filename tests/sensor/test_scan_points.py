# SPDX-License-Identifier: Apache-2.0
"""The points of many scans in one array."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.sensor.scan_points import ScanPoints

COUNTS = (3, 0, 5)
SCANS = [np.random.default_rng(k).uniform(-9.0, 9.0, (k, 2)) for k in COUNTS]


def same(scans, expected):
    assert len(scans) == len(expected)
    for scan, points in zip(scans, expected, strict=True):
        np.testing.assert_array_equal(scan, points)


def test_each_scan_has_its_points():
    scans = ScanPoints.of(SCANS)
    same(scans, SCANS)
    assert scans.counts.tolist() == list(COUNTS)
    np.testing.assert_array_equal(scans[-1], SCANS[-1])


def test_scans_can_be_selected_without_copying_points():
    scans = ScanPoints.of(SCANS)
    taken = scans.take(np.array((2, 0, 2)))
    same(taken, [SCANS[2], SCANS[0], SCANS[2]])
    assert np.shares_memory(taken[0], scans.points)
    same(scans[1:], SCANS[1:])


def test_no_scans_are_allowed():
    assert len(ScanPoints.of([])) == 0
    with pytest.raises(IndexError):
        ScanPoints.of([])[0]
