# SPDX-License-Identifier: Apache-2.0
"""Faults of what a scanner sees, and recordings of other speeds, sizes and origins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.robustness.carmen_text import CarmenText
from bench.robustness.odometry_changes import far_origin
from bench.robustness.several_changes import scaled
from bench.robustness.stamp_changes import stretched
from bench.robustness.view_faults import blinded, companion, mixed_pixels, warming
from cartoloop.sensor.pose import relative_all

NO_RETURN = 81.91


@pytest.fixture
def log():
    """A log of two scans a second, straight on; walls at 2 m and 6 m, the last beam sees none."""
    count = 200
    poses = np.column_stack((0.1 * np.arange(count), np.zeros((count, 2))))
    ranges = np.append(np.where(np.arange(179) // 20 % 2, 2.0, 6.0), NO_RETURN)
    tails = [[f"{0.5 * row:.6f}", "robot", f"{0.5 * row:.6f}"] for row in range(count)]
    return CarmenText([], poses, [ranges.copy() for _ in range(count)], tails)


def applied(log, change, seed=0):
    """Return the ranges before and after a change, shapes (n, num_beams)."""
    before = np.array(log.ranges)
    change(log, np.random.default_rng(seed))
    return before, np.array(log.ranges)


def test_mixed_pixels_lie_between_both_sides_of_edges(log):
    before, after = applied(log, mixed_pixels(0.5))
    changed = before != after
    assert np.mean(np.count_nonzero(changed, axis=1)) == pytest.approx(4.0, abs=0.5)
    assert (before[changed] == 2.0).all()
    assert ((after[changed] > 2.0) & (after[changed] < 6.0)).all()


def test_the_sun_blinds_a_sector_for_some_seconds(log):
    before, after = applied(log, blinded(0.3, 5.0, math.radians(40.0)))
    hidden = (after == NO_RETURN) & (before != NO_RETURN)
    assert np.array_equal(after[~hidden], before[~hidden])
    blind = np.count_nonzero(hidden, axis=1)
    assert 0.1 < np.mean(blind > 0) <= 0.3
    assert blind.max() in range(19, 42)


def test_a_companion_hides_what_is_behind(log):
    before, after = applied(log, companion(math.radians(30.0)))
    hidden = before != after
    assert (np.count_nonzero(hidden, axis=1) > 10).all()
    assert hidden[:, 120].all()
    assert not hidden[:, :90].any()
    assert after[hidden].mean() == pytest.approx(1.2, abs=0.05)


def test_a_scanner_gets_warm_until_half_way(log):
    before, after = applied(log, warming(0.04))
    longer = after - before
    assert longer[:, -1] == pytest.approx(0.0)
    assert longer[0, 0] == pytest.approx(0.0)
    assert longer[50, 0] == pytest.approx(0.02, abs=0.001)
    assert longer[-1, 0] == pytest.approx(0.04)


def test_a_far_origin_changes_no_step_of_the_odometry(log):
    before = log.poses.copy()
    far_origin(log, np.random.default_rng(0))
    assert np.hypot(*log.poses[:, :2].T).min() > 1e6
    assert np.allclose(relative_all(log.poses[:-1], log.poses[1:]), np.diff(before, axis=0))


def test_all_lengths_are_scaled(log):
    before, after = applied(log, scaled(0.8))
    assert after[:, :-1] == pytest.approx(0.8 * before[:, :-1])
    assert log.poses[-1, 0] == pytest.approx(0.8 * 19.9)


def test_a_slower_robot_takes_as_much_longer(log):
    times = stretched(3.0)(log.times, np.random.default_rng(0))
    assert times[0] == log.times[0]
    assert np.diff(times) == pytest.approx(3.0 * np.diff(log.times))
