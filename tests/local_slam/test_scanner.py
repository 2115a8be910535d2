# SPDX-License-Identifier: Apache-2.0
"""What the latest scans of a scanner say about its motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.config import LocalSlamConfig
from cartoloop.local_slam.scanner import Scanner
from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.range_noise import Noise

GEOMETRY = ScanGeometry(
    angle_min=-1.0, angle_increment=0.1, num_beams=20, range_min=0.1, range_max=10.0
)


def scanner_with(*scans):
    scanner = Scanner.of(LocalSlamConfig())
    for time, ranges in enumerate(scans):
        scanner.count(LaserScan(float(time), float(time), np.array(ranges), GEOMETRY))
    return scanner


def test_the_share_of_ranges_that_changed():
    before = np.full(20, 2.0)
    after = before + np.where(np.arange(20) < 5, 0.5, 0.02)
    assert scanner_with(before, after).changed_share_since(0.0) == pytest.approx(0.25)


def test_only_beams_that_measured_both_times_count():
    before, after = np.full(20, 2.0), np.full(20, 2.0)
    before[:5], after[5:10] = 0.0, 10.0
    after[10:12] = 3.0
    scanner = scanner_with(before, after)
    assert scanner.changed_share_since(0.0) == pytest.approx(0.2)
    assert scanner.change_since(0.0) == 0.0


def test_noise_in_far_ranges_is_no_change():
    rng = np.random.default_rng(0)
    ranges = np.linspace(1.0, 9.0, 20)
    scans = ranges * (1.0 + 0.01 * rng.standard_normal((2, 20)))
    assert scanner_with(*scans).changed_share_since(0.0) == 0.0


def test_noise_of_a_noisy_scanner_is_no_change():
    rng = np.random.default_rng(0)
    ranges = np.linspace(1.0, 9.0, 20)
    scanner = scanner_with(*(ranges * (1.0 + 0.03 * rng.standard_normal((2, 20)))))
    assert scanner.changed_share_since(0.0) > 0.0
    scanner.noise = Noise(share=0.03)
    assert scanner.changed_share_since(0.0) == 0.0


def test_nothing_is_known_of_one_scan_or_after_all():
    scanner = scanner_with(np.full(20, 2.0), np.full(20, 4.0))
    assert scanner.changed_share_since(1.0) == 0.0
    assert scanner.change_since(1.0) == math.inf
    assert scanner.changed_share_since(5.0) == 0.0
