# SPDX-License-Identifier: Apache-2.0
"""Changed recordings of the benchmark ``robustness``."""

from __future__ import annotations

import gzip
import math
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from bench.robustness.carmen_text import read_carmen
from bench.robustness.changes import CHANGES, UNCHANGED, NothingLeft, changed_log, changed_relations
from bench.robustness.log_changes import held
from cartoloop.errors import InputError
from cartoloop.evaluation.relations import Relations
from cartoloop.readers import open_log
from cartoloop.sensor.events import LaserScan
from cartoloop.sensor.pose import relative_all
from cartoloop.simulation import LIDARS, make_world, simulate

LIDAR = replace(LIDARS["sick-180"], rate=2.0)


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    path = tmp_path_factory.mktemp("robustness") / "ring.log.gz"
    simulate(make_world("ring"), LIDAR, duration=100.0).write_carmen(path)
    return path


@pytest.fixture(scope="module")
def original(source):
    return read_carmen(source)


def changed(source, tmp_path, name, seed=0):
    target = tmp_path / "changed.clf"
    changed_log(source, target, CHANGES[name], seed)
    return read_carmen(target) if name != "beams2" else target


def ranges_of(log):
    return np.array([ranges for ranges in log.ranges if ranges is not None])


def test_an_unchanged_log_reads_the_same(source, original, tmp_path):
    log = changed(source, tmp_path, UNCHANGED)
    assert np.array_equal(log.poses, original.poses)
    assert np.array_equal(ranges_of(log), ranges_of(original))
    assert np.array_equal(log.times, original.times)


@pytest.mark.parametrize("name", sorted(CHANGES))
def test_changes_follow_from_the_seed_and_can_be_read(source, tmp_path, name):
    contents = []
    for seed in (1, 1, 2) if CHANGES[name].seeds > 1 else (1, 2):
        target = tmp_path / "changed.clf"
        try:
            changed_log(source, target, CHANGES[name], seed)
        except NothingLeft:
            assert name.startswith(("end", "start"))
            return
        contents.append(target.read_bytes())
    assert contents[0] == contents[1]
    assert len(set(contents)) == len(contents) - 1
    assert any(isinstance(event, LaserScan) for event in open_log(tmp_path / "changed.clf"))


@pytest.mark.parametrize("line", ["FLASER 3 1 2", "ODOM 1.0 2.0", "ODOM 1 2 3 0 0"])
def test_a_line_that_ends_early_is_reported(source, tmp_path, line):
    log = tmp_path / "short.clf"
    log.write_bytes(gzip.decompress(source.read_bytes()) + f"{line}\n".encode())
    with pytest.raises(InputError, match="ends early"):
        read_carmen(log)


def test_scans_are_left_out_and_odometry_is_kept(source, original, tmp_path):
    log = changed(source, tmp_path, "drop50")
    assert len(log.ranges) == len(original.ranges) - len(original.ranges) // 50
    assert changed(source, tmp_path, "start60").times[0] >= original.times[0] + 60.0


def test_sparse_scans_are_a_metre_or_a_turn_apart(source, original, tmp_path):
    log = changed(source, tmp_path, "sparse")
    assert len(log.ranges) == len(original.ranges)
    assert np.array_equal(log.poses, original.poses)
    assert np.array_equal(log.times, original.times)
    steps = relative_all(log.poses[log.is_scan][:-1], log.poses[log.is_scan][1:])
    moved, turned = np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])
    assert ((moved >= 1.0) | (turned >= math.radians(30.0))).all()
    assert np.median(moved) < 1.5


def test_noise_has_the_size_that_its_name_says(source, original, tmp_path):
    log = changed(source, tmp_path, "noise1cm")
    before, after = ranges_of(original), ranges_of(log)
    seen = before < 40.0
    assert np.std((after - before)[seen]) == pytest.approx(0.01, rel=0.05)
    assert np.array_equal(after[~seen], before[~seen])


def test_odometry_is_longer_and_drifts(source, original, tmp_path):
    def steps(log):
        return relative_all(log.poses[:-1], log.poses[1:])

    before = steps(original)
    lengths = np.hypot(before[:, 0], before[:, 1])
    longer = steps(changed(source, tmp_path, "scale103"))
    assert np.hypot(longer[:, 0], longer[:, 1]) == pytest.approx(1.03 * lengths, abs=1e-5)
    assert longer[:, 2] == pytest.approx(before[:, 2], abs=1e-5)
    drifts = steps(changed(source, tmp_path, "drift05"))
    assert drifts[:, 2] - before[:, 2] == pytest.approx(math.radians(0.5) * lengths, abs=1e-5)


def test_odometry_is_that_of_a_later_time(source, original, tmp_path):
    log = changed(source, tmp_path, "toff02")
    expected = [
        np.interp(original.times + 0.2, original.times, original.poses[:, axis]) for axis in (0, 1)
    ]
    assert np.abs(log.poses[:, :2].T - expected).max() < 1e-4


def test_jittering_odometry_is_that_of_times_nearby(source, original, tmp_path):
    jittering = changed(source, tmp_path, "jitter")
    nearest, late = [], 0
    for time, pose in zip(original.times, jittering.poses[:, :2], strict=True):
        apart = np.hypot(*(original.poses[:, :2] - pose).T)
        is_near = np.abs(original.times - time) < 0.6  # six standard deviations
        nearest.append(apart[is_near].min())
        late += apart[original.times == time].min() > 0.01
    steps = np.hypot(*np.diff(original.poses[:, :2], axis=0).T)
    assert max(nearest) <= steps.max()
    assert late > 0.2 * len(nearest)
    assert np.array_equal(jittering.times, original.times)


def test_a_cheap_robot_sees_8_m_and_has_noisy_wheels(source, original, tmp_path):
    cheap = changed(source, tmp_path, "cheap")
    before, after = ranges_of(original), ranges_of(cheap)
    assert np.array_equal(after[before <= 8.0], before[before <= 8.0])
    assert (after[before > 8.0] == original.no_return).all()
    moved, said = (np.diff(log.poses[:, :2], axis=0) for log in (original, cheap))
    lengths = np.hypot(*moved.T)
    moves = lengths > 0.02
    ratio = np.hypot(*said.T)[moves] / lengths[moves]
    assert 0.05 < ratio.std() < 0.15


def test_a_lossy_robot_loses_scans_and_has_noisy_wheels(source, original, tmp_path):
    lossy = changed(source, tmp_path, "lossy")
    assert np.diff(lossy.times[lossy.is_scan]).max() > 4.0
    kept = np.isin(original.times, lossy.times)
    moved, said = (np.diff(poses[:, :2], axis=0) for poses in (original.poses[kept], lossy.poses))
    lengths = np.hypot(*moved.T)
    # Over a gap, the errors of many steps cancel each other.
    moves = (lengths > 0.02) & (lengths < 0.3)
    ratio = np.hypot(*said.T)[moves] / lengths[moves]
    assert 0.05 < ratio.std() < 0.15


def test_thinned_beams_keep_their_angles(source, original, tmp_path):
    target = changed(source, tmp_path, "beams2")
    scans = [event for event in open_log(target) if isinstance(event, LaserScan)]
    assert scans[0].geometry.num_beams == 90
    assert scans[0].geometry.angles == pytest.approx(LIDAR.geometry.angles[::2], abs=1e-6)
    assert scans[3].ranges == pytest.approx(ranges_of(original)[3, ::2])


def test_missing_returns_are_as_rare_as_their_name_says(source, original, tmp_path):
    log = changed(source, tmp_path, "missing10")
    missing = (ranges_of(log) == original.no_return) & (ranges_of(original) < original.no_return)
    assert missing.mean() == pytest.approx(0.1, abs=0.01)


def test_a_blocked_sector_has_no_returns(source, original, tmp_path):
    ranges = ranges_of(changed(source, tmp_path, "blocked"))
    count = ranges.shape[1]
    is_blocked = (ranges == original.no_return).all(axis=0)
    assert is_blocked.mean() == pytest.approx(0.12, abs=1.5 / count)
    assert np.array_equal(ranges[:, ~is_blocked], ranges_of(original)[:, ~is_blocked])


def test_noise_grows_with_the_range(source, original, tmp_path):
    before, after = ranges_of(original), ranges_of(changed(source, tmp_path, "noise-share"))
    seen = before < original.no_return
    assert np.std(after[seen] / before[seen] - 1.0) == pytest.approx(0.015, rel=0.05)
    assert np.array_equal(after[~seen], before[~seen])


def test_some_seconds_of_each_minute_are_paused(source, original, tmp_path):
    times = changed(source, tmp_path, "pauses").times
    assert np.isin(times, original.times).all()
    steps = np.diff(times)
    assert (steps > 3.0).sum() == (original.times[-1] - original.times[0]) // 60.0
    assert steps.max() < 3.0 + 3.0 * np.diff(original.times).max()


def test_scans_of_some_seconds_are_lost(source, original, tmp_path):
    lossy = changed(source, tmp_path, "gaps")
    assert np.isin(lossy.times, original.times).all()
    assert (~lossy.is_scan).sum() == (~original.is_scan).sum()
    duration = original.times[-1] - original.times[0]
    steps = np.diff(lossy.times[lossy.is_scan])
    assert 1 <= (steps > 4.0).sum() <= 0.05 * duration / 4.0
    share = 1.0 - lossy.is_scan.sum() / original.is_scan.sum()
    assert 0.0 < share < 0.06


def test_frozen_odometry_misses_some_seconds(source, original, tmp_path):
    frozen = changed(source, tmp_path, "frozen")
    before, after = steps_of(original.poses)[0], steps_of(frozen.poses)[0]
    is_missed = (before > 1e-3) & (after < 1e-9)
    assert after[~is_missed] == pytest.approx(before[~is_missed], abs=1e-4)
    assert 0.02 < is_missed[before > 1e-3].mean() < 0.25


def test_a_wrong_gear_doubles_steps_and_turns(source, original, tmp_path):
    doubled = changed(source, tmp_path, "wheels2")
    for before, after in zip(steps_of(original.poses), steps_of(doubled.poses), strict=True):
        assert after == pytest.approx(2.0 * before, abs=1e-4)


def steps_of(poses):
    steps = relative_all(poses[:-1], poses[1:])
    return np.hypot(steps[:, 0], steps[:, 1]), steps[:, 2]


def test_odometry_that_is_seldom_read_is_repeated(source, original, tmp_path):
    seldom = changed(source, tmp_path, "seldom-read")
    assert np.array_equal(seldom.times, original.times)
    is_new = np.append(True, (np.diff(seldom.poses, axis=0) != 0.0).any(axis=1))
    assert np.diff(original.times[is_new]).min() >= 1.0
    assert np.array_equal(seldom.poses[is_new], original.poses[is_new])


def test_beams_in_the_other_order_have_mirrored_angles(source, original, tmp_path):
    before, after = ranges_of(original), ranges_of(changed(source, tmp_path, "upside-down"))
    count = before.shape[1]
    # in the mirrored scan, the beam at an angle is that at its negative
    angles = np.arange(count) - count // 2
    for beam, angle in enumerate(angles.tolist()):
        place = np.flatnonzero(angles == -angle)
        expected = before[:, place[0]] if len(place) else original.no_return
        np.testing.assert_array_equal(after[:, beam], expected)


def test_each_reading_is_there_twice(source, original, tmp_path):
    log = changed(source, tmp_path, "twice")

    np.testing.assert_array_equal(log.times, np.repeat(original.times, 2))
    np.testing.assert_array_equal(log.poses, np.repeat(original.poses, 2, axis=0))
    np.testing.assert_array_equal(ranges_of(log), np.repeat(ranges_of(original), 2, axis=0))


def test_scans_are_repeated_for_some_seconds(original):
    log = deepcopy(original)
    held(0.1, 1.6)(log, np.random.default_rng(0))

    before, after = ranges_of(original), ranges_of(log)
    is_held = (before != after).any(axis=1)
    assert 0.1 < is_held.mean() < 0.4
    times = log.times[log.is_scan]
    for row in np.flatnonzero(is_held).tolist():
        np.testing.assert_array_equal(after[row], after[row - 1])
        since = row - np.argmax(~is_held[row::-1])
        assert times[row] - times[since] < 1.6


def test_walls_seen_at_a_slant_return_nothing(source, original, tmp_path):
    before, after = ranges_of(original), ranges_of(changed(source, tmp_path, "slanting"))
    is_kept = after == before
    steps = np.abs(np.diff(before, axis=1))
    assert is_kept[:, 1:][steps == 0.0].mean() > 0.9
    assert (after[~is_kept] == original.no_return).all()
    assert 0.0 < is_kept.mean() < 1.0


def test_outliers_are_as_rare_as_their_name_says(source, original, tmp_path):
    is_other = ranges_of(changed(source, tmp_path, "outliers2")) != ranges_of(original)
    assert is_other.mean() == pytest.approx(0.02, abs=0.003)


def test_combined_changes_are_several(source, original, tmp_path):
    logs = [changed(source, tmp_path, "combined", seed) for seed in range(4)]
    assert len({len(log.ranges) for log in logs}) > 1
    assert all(
        len(log.poses) != len(original.poses)
        or not np.array_equal(log.poses, original.poses)
        or not np.array_equal(ranges_of(log), ranges_of(original))
        for log in logs
    )


def test_a_recording_played_backwards_ends_where_it_began(source, original, tmp_path):
    log = changed(source, tmp_path, "backwards")
    assert np.array_equal(log.poses, original.poses[::-1])
    assert np.array_equal(ranges_of(log), ranges_of(original)[::-1])
    assert (np.diff(log.times) >= 0.0).all()
    assert log.times == pytest.approx(original.times[0] + original.times[-1] - original.times[::-1])


def test_people_hide_some_of_the_walls(source, original, tmp_path):
    log = changed(source, tmp_path, "people")
    nearer = ranges_of(original) - ranges_of(log)
    assert nearer.min() >= 0.0
    assert 0.02 < np.mean(nearer > 0.1) < 0.4
    hidden = nearer[50:] > 0.1
    assert np.mean(hidden.any(axis=0)) > 0.1  # they walk


def test_messages_that_arrive_in_bursts_keep_their_order(source, original, tmp_path):
    log = changed(source, tmp_path, "bursts", seed=1)
    late = log.times - original.times
    assert np.array_equal(log.poses, original.poses)
    assert (np.diff(log.times) >= 0.0).all()
    assert 0.02 < np.mean(late > 0.0) < 0.5
    assert 0.4 < late.max() < 2.6
    assert late.min() > -1e-6


def test_relations_of_late_messages_have_their_stamps(source, original, tmp_path):
    log = changed(source, tmp_path, "bursts", seed=1)
    pairs = original.times[[[3, 50], [120, 7]]]
    relations = Relations(pairs, np.zeros((2, 3)))
    late = changed_relations(relations, CHANGES["bursts"], original, 1)
    assert late.stamps == pytest.approx(log.times[[[3, 50], [120, 7]]], abs=1e-5)
