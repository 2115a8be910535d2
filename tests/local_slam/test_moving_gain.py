# SPDX-License-Identifier: Apache-2.0
"""Whether a robot moved between two scans, or people walked around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cartoloop.local_slam.moving_gain import (
    ALL_BY_REST,
    FARTHEST_M,
    SPACING_M,
    SeenScan,
    explained,
    have_changed,
)
from cartoloop.local_slam.odometry_rest import MIN_GAIN
from cartoloop.sensor.events import LaserScan
from cartoloop.sensor.pose import Pose, relative
from cartoloop.sensor.range_noise import NO_NOISE
from cartoloop.simulation import office, simulate


@pytest.fixture(scope="module")
def drive():
    return simulate(office(), duration=60.0)


@pytest.fixture(scope="module")
def scans(drive):
    return [event for event in drive.events() if isinstance(event, LaserScan)]


def steps_of(drive, apart):
    """The motions from each scan to a later one, and their rows."""
    poses = [Pose(*pose) for pose in drive.true_poses.tolist()]
    return [relative(one, other) for one, other in zip(poses, poses[apart:], strict=False)]


def with_people(scan, rng, share):
    """A scan in which people stand before some of the walls: in blocks of beams."""
    ranges, count = scan.ranges.copy(), len(scan.ranges)
    while np.mean(ranges != scan.ranges) < share:
        first, width = int(rng.integers(count)), int(rng.integers(5, 25))
        rows = np.arange(first, first + width) % count
        ranges[rows] = np.minimum(ranges[rows], rng.uniform(0.8, 2.5))
    return replace(scan, ranges=ranges)


def moving_gain(before, now):
    shares = explained(SeenScan(before), SeenScan(now), NO_NOISE, (0.0, 0.0))
    return shares.by_motion - shares.by_rest


def reference(before, now, velocity):
    """The shares, beam by beam."""
    geometry, shares = before.geometry, []
    is_before, is_now = SeenScan(before).is_comparable, SeenScan(now).is_comparable
    steps = [k * SPACING_M for k in range(1, round(FARTHEST_M / SPACING_M) + 1)]
    seconds = now.time - before.time
    motions = [(0.0, 0.0), (velocity[0] * seconds, velocity[1] * seconds)]
    for step in steps:
        motions += [(step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step)]
    at_rest = {}
    for x, y in motions:
        seen, fitting, resting, count = 0, 0, 0, 0
        for beam, distance in enumerate(now.ranges.tolist()):
            if not is_now[beam]:
                continue
            count += 1
            bearing = geometry.angle_min + beam * geometry.angle_increment
            place_x, place_y = distance * np.cos(bearing) + x, distance * np.sin(bearing) + y
            towards = np.arctan2(place_y, place_x)
            of_all = geometry.angle_min + geometry.angle_increment * np.arange(len(before.ranges))
            off = np.abs(np.angle(np.exp(1j * (of_all - towards))))
            nearest = int(np.argmin(off))
            if off[nearest] > 0.5 * geometry.angle_increment + 1e-9:
                continue
            there = before.ranges[nearest]
            if not is_before[nearest]:
                continue
            seen += 1
            apart = np.array([there]), np.array([np.hypot(place_x, place_y)])
            fits = not have_changed(*apart, NO_NOISE)[0]
            if not shares:
                at_rest[beam] = fits
            if beam in at_rest:
                fitting += fits
                resting += at_rest[beam]
        shares.append((fitting - (resting if shares else 0)) / max(seen, 0.5 * count))
    rest, *gains = shares
    return rest, rest + gains[0], rest + max(0.0, *gains)


def test_a_robot_that_drives_on_is_noticed(drive, scans):
    moved = [
        moving_gain(before, now)
        for before, now, step in zip(scans, scans[3:], steps_of(drive, 3), strict=False)
        if np.hypot(step.x, step.y) > 0.3 and abs(step.theta) < 0.02
    ]
    assert len(moved) > 10
    assert np.mean(np.array(moved) > MIN_GAIN) > 0.9


def test_people_around_a_robot_at_rest_are_no_motion(scans):
    rng = np.random.default_rng(1)
    gains = [
        moving_gain(with_people(scan, rng, 0.2), with_people(scan, rng, 0.2)) for scan in scans[::5]
    ]
    assert np.mean(gains) < 0.2 * MIN_GAIN


def test_people_and_beams_without_a_return_are_not_compared(scans):
    ranges = np.full_like(scans[0].ranges, 4.0)
    ranges[50:60], ranges[90] = 1.5, np.inf
    expected = np.ones(len(ranges), dtype=np.bool_)
    expected[50:60] = expected[90] = False
    assert SeenScan(replace(scans[0], ranges=ranges)).is_comparable.tolist() == expected.tolist()


def test_the_expected_motion_explains_what_a_driving_robot_sees(drive, scans):
    better = []
    for before, now, step in zip(scans, scans[5:], steps_of(drive, 5), strict=False):
        if np.hypot(step.x, step.y) > 0.5 and abs(step.theta) < 0.02:
            seconds = now.time - before.time
            shares = explained(
                SeenScan(before), SeenScan(now), NO_NOISE, (step.x / seconds, step.y / seconds)
            )
            better.append(shares.by_expected > shares.by_rest)
    assert len(better) > 10
    assert np.mean(better) > 0.95


def test_shares_are_those_of_single_beams(scans):
    rng = np.random.default_rng(2)
    for row in (10, 60, 110):
        before, now = with_people(scans[row], rng, 0.1), scans[row + 2]
        shares = explained(SeenScan(before), SeenScan(now), NO_NOISE, (0.4, -0.1))
        assert shares == pytest.approx(reference(before, now, (0.4, -0.1)), abs=0.01)


def test_scans_without_returns_show_no_motion(scans):
    blind = replace(scans[0], ranges=np.full_like(scans[0].ranges, np.inf))
    assert explained(SeenScan(scans[1]), SeenScan(blind), NO_NOISE, (0.0, 0.0)) == ALL_BY_REST
    assert moving_gain(blind, scans[1]) == 0.0


def test_the_expected_motion_is_that_of_the_robot(drive, scans):
    """A scanner that looks to the left sees a robot that drives ahead move to its right."""
    row = next(
        n for n, step in enumerate(steps_of(drive, 5)) if step.x > 0.5 and abs(step.theta) < 0.01
    )
    turned = [
        replace(
            scan, geometry=replace(scan.geometry, tf_tracking_sensor=Pose(0.0, 0.0, np.pi / 2.0))
        )
        for scan in (scans[row], scans[row + 5])
    ]
    seconds = turned[1].time - turned[0].time
    step = steps_of(drive, 5)[row]
    aside = explained(*map(SeenScan, turned), NO_NOISE, (0.0, step.x / seconds))
    pair = SeenScan(scans[row]), SeenScan(scans[row + 5])
    ahead = explained(*pair, NO_NOISE, (step.x / seconds, 0.0))
    assert aside.by_expected == pytest.approx(ahead.by_expected, abs=1e-9)
