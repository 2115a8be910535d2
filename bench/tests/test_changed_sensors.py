# SPDX-License-Identifier: Apache-2.0
"""Changes of what the scanner sees, where it is mounted, of turns, of clocks, and of several."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.robustness.carmen_text import CarmenText
from bench.robustness.changes import CHANGES
from bench.robustness.log_changes import one_scan_in, short_sighted
from bench.robustness.odometry_changes import (
    coarse_odometry,
    drifting_clock,
    left_handed,
    no_motion,
    restarted,
    second_half,
    skidding_turns,
    turning_in_bursts,
    turning_more,
)
from bench.robustness.scanner_changes import (
    OWN_PART_M,
    biased,
    bumps,
    mounted,
    narrow,
    own_parts,
    rounded,
    wider_fan,
    zero_for_none,
)
from bench.robustness.several_changes import both, depth_camera
from bench.robustness.stamp_changes import rounded_stamps
from cartoloop.sensor.pose import compose_all, relative_all

NO_RETURN = 81.91


@pytest.fixture
def log():
    """A log of a scan a second, on a circle; the last beam has no return."""
    rng = np.random.default_rng(1)
    count = 200
    headings = 0.015 * np.arange(count)
    poses = np.column_stack((10.0 * np.sin(headings), -10.0 * np.cos(headings), headings))
    ranges = [np.append(rng.uniform(1.0, 9.0, 179), NO_RETURN) for _ in range(count)]
    tails = [[f"{0.5 * row:.6f}", "robot", f"{0.5 * row:.6f}"] for row in range(count)]
    return CarmenText([], poses, ranges, tails)


def applied(log, change, seed=0):
    """Return the log as it was, before it is changed in place."""
    before = CarmenText(
        [], log.poses.copy(), [ranges.copy() for ranges in log.ranges], list(log.tails)
    )
    change(log, np.random.default_rng(seed))
    return before


def steps(log):
    return relative_all(log.poses[:-1], log.poses[1:])


def test_a_narrow_view_keeps_the_beams_ahead(log):
    before = applied(log, narrow(math.radians(90.0)))
    assert log.num_beams == 91
    assert log.angles == pytest.approx((math.radians(-45.0), math.radians(1.0)))
    assert np.array_equal(log.ranges[0], before.ranges[0][45:136])


def test_ranges_are_rounded_and_biased_where_seen(log):
    before = applied(log, both(rounded(0.05), biased(0.03)))
    seen = log.ranges[3][:-1]
    assert (seen - 0.03) / 0.05 == pytest.approx(np.round((seen - 0.03) / 0.05))
    assert np.abs(seen - 0.03 - before.ranges[3][:-1]).max() <= 0.025 + 1e-9
    assert log.ranges[3][-1] == NO_RETURN


def test_own_parts_are_on_both_sides(log):
    before = applied(log, own_parts(0.05))
    assert (log.ranges[0][:9] == OWN_PART_M).all()
    assert (log.ranges[0][-9:] == OWN_PART_M).all()
    assert np.array_equal(log.ranges[0][9:-9], before.ranges[0][9:-9])


def test_bumps_show_the_floor_for_some_seconds(log):
    before = applied(log, bumps(0.2, 2.0, 4.0))
    is_bump = np.array(
        [not np.array_equal(*pair) for pair in zip(log.ranges, before.ranges, strict=True)]
    )
    assert 0.05 < is_bump.mean() < 0.25
    row = int(np.flatnonzero(is_bump)[0])
    assert log.ranges[row][90] <= 4.0 + 1e-9
    assert log.ranges[row][30] == pytest.approx(min(before.ranges[row][30], 8.0))


def test_zeros_stand_for_beams_without_a_return(log):
    before = applied(log, zero_for_none)
    assert log.ranges[0][-1] == 0.0
    assert np.array_equal(log.ranges[0][:-1], before.ranges[0][:-1])


def test_poses_are_those_of_a_robot_that_carries_the_scanner(log):
    before = applied(log, mounted(0.3, 0.1, 0.5))
    mounting = np.repeat([[0.3, 0.1, 0.5]], len(log.poses), axis=0)
    assert compose_all(log.poses, mounting) == pytest.approx(before.poses)


def test_turns_are_larger_by_a_share(log):
    before = steps(applied(log, CHANGES["turns110"].apply))
    assert steps(log)[:, 2] == pytest.approx(1.1 * before[:, 2])
    assert np.allclose(turning_more(0.1)(before), before * (1.0, 1.0, 1.1))


def test_turns_skid_by_another_share_after_some_seconds(log):
    before = steps(applied(log, skidding_turns(0.4, 5.0)))
    factors = steps(log)[:, 2] / before[:, 2]
    assert np.abs(factors - 1.0).max() <= 0.4 + 1e-9
    assert np.ptp(factors[:9]) == pytest.approx(0.0, abs=1e-9)
    assert len(np.unique(factors.round(6))) == 20
    assert steps(log)[:, :2] == pytest.approx(before[:, :2])


def test_coarse_odometry_repeats_rounded_poses(log):
    applied(log, coarse_odometry(0.01, math.radians(1.0), 1.0))
    assert np.array_equal(log.poses[::2], log.poses[1::2])
    assert np.degrees(log.poses[:, 2]) == pytest.approx(np.round(np.degrees(log.poses[:, 2])))


def test_odometry_turns_by_itself_in_bursts(log):
    before = steps(applied(log, turning_in_bursts(math.radians(1.0), 0.3, 5.0)))
    turned = np.degrees(steps(log)[:, 2] - before[:, 2])
    is_burst = np.abs(turned) > 1e-6
    assert 0.1 < is_burst.mean() < 0.35
    assert np.abs(turned[is_burst]) == pytest.approx(0.5)
    assert steps(log)[:, :2] == pytest.approx(before[:, :2])


def test_a_fast_clock_takes_odometry_from_later_times(log):
    before = applied(log, drifting_clock(0.01))
    assert log.poses[0] == pytest.approx(before.poses[0])
    assert log.poses[100] == pytest.approx(before.poses[101], abs=1e-4)


def test_restarted_odometry_begins_at_zero_after_a_gap(log):
    before = applied(log, restarted(5.0))
    middle = int(np.flatnonzero(np.diff(log.times) > 1.0)[0]) + 1
    assert log.times[middle] - log.times[middle - 1] > 5.0
    assert log.poses[middle] == pytest.approx(0.0)
    assert steps(log)[middle:] == pytest.approx(steps(before)[-len(steps(log)[middle:]) :])


def test_odometry_of_no_motion_and_of_the_other_hand(log):
    before = applied(log, left_handed)
    assert np.array_equal(log.poses, before.poses * (1.0, -1.0, -1.0))
    no_motion(log, np.random.default_rng(0))
    assert not log.poses.any()


def test_a_depth_camera_sees_little(log):
    applied(log, both(wider_fan(0.01), depth_camera))
    assert log.num_beams == 59
    assert log.angles == pytest.approx((math.radians(-29.29), math.radians(1.01)))
    assert log.ranges[0][log.ranges[0] < NO_RETURN].max() < 8.2


def test_the_second_half_and_every_third_scan_are_left(log):
    before = applied(log, both(second_half, one_scan_in(3), short_sighted(5.0)))
    assert log.times[0] >= 0.5 * before.times[-1]
    assert np.diff(log.times) == pytest.approx(1.5)
    assert log.ranges[0].max() == NO_RETURN
    assert log.ranges[0][log.ranges[0] < NO_RETURN].max() <= 5.0


def test_stamps_in_whole_seconds_still_name_scans():
    times = np.array((0.2, 0.4, 0.9, 1.0, 1.9, 5.2))
    named = rounded_stamps(times, np.random.default_rng(0))
    assert named == pytest.approx((0.0, 0.001, 0.002, 1.0, 1.001, 5.0))
