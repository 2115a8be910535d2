# SPDX-License-Identifier: Apache-2.0
"""Wheels that slip between bare walls: what the matches followed is made up for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.config import LocalSlamConfig, WallStepConfig
from cartoloop.local_slam.odometry_trust import OdometryTrust
from cartoloop.local_slam.odometry_window import Evidence
from cartoloop.local_slam.pose_extrapolator import PoseExtrapolator
from cartoloop.local_slam.scanner import Scanner
from cartoloop.local_slam.slip import since_slip, slip_began
from cartoloop.local_slam.wall_step import WallStep
from cartoloop.sensor.pose import IDENTITY, Pose, compose
from cartoloop.sensor.range_noise import Noise
from tests.local_slam.test_wall_step import corridor_scan

PERIOD, SPEED = 0.5, 1.0
HEADING = 0.7
ALONG = np.array((math.cos(HEADING), math.sin(HEADING)))
WALLS = Evidence(False, HEADING, lambda _: math.inf, lambda: 0.0)
CUPBOARDS = tuple(edge for k in range(12) for edge in (3.0 * k, 3.0 * k + 1.5))


def at(distance):
    """Return a pose along the corridor."""
    x, y = (distance * ALONG).tolist()
    return Pose(x, y, HEADING)


def driven(speeds):
    """Return an extrapolator whose matches followed odometry with speeds, and the last time."""
    extrapolator, distance = PoseExtrapolator(LocalSlamConfig()), 0.0
    for k, speed in enumerate([0.0, *speeds]):
        distance += PERIOD * speed
        extrapolator.add_odometry(PERIOD * k, at(distance))
        extrapolator.add_pose(PERIOD * k, at(distance), evidence=WALLS)
    return extrapolator, distance, PERIOD * len(speeds)


def timed(speeds):
    """Return poses along the corridor, half a second apart, that show the speeds."""
    distances = PERIOD * np.cumsum([0.0, *speeds])
    return [(PERIOD * k, at(float(one))) for k, one in enumerate(distances)]


def test_a_slip_begins_where_the_speed_changes():
    assert slip_began(timed([1.0, 1.0, 1.0, 0.2, 0.2, 0.2]), ALONG, 0.8) == 3 * PERIOD
    assert slip_began(timed([1.0, 1.0, 0.6, 0.2, 0.2]), ALONG, 0.8) == 3 * PERIOD
    assert slip_began(timed([-1.0, -1.0, -1.8, -1.8]), ALONG, 0.8) == 2 * PERIOD


@pytest.mark.parametrize("speeds", [[0.1] * 40, [0.0, *[0.1] * 30], [0.4, *[0.1] * 30]])
def test_slip_of_a_slow_robot_is_not_made_up_for(speeds):
    """A person who walks by seems to show that a robot which drives slowly is fast."""
    poses = timed(speeds)
    time, matched = poses[-1]
    assert slip_began(poses, ALONG, 0.6) == time
    shown = compose(matched, Pose(0.3, 0.0, 0.0))
    assert since_slip(poses, shown, tuple((0.6 * ALONG).tolist())) == shown


@pytest.mark.parametrize("share", [0.1, 1.8])
def test_a_slip_is_made_up_for_since_it_began(share):
    extrapolator, distance, time = driven([SPEED] * 6 + [share * SPEED] * 4)
    missed = tuple(((1.0 - share) * SPEED * ALONG).tolist())
    matched = at(distance + PERIOD * share * SPEED)
    step = PERIOD * (1.0 - share) * SPEED
    shown = compose(matched, Pose(step, 0.0, 0.0))

    pose = extrapolator.since_slip(time + PERIOD, matched, shown, missed)

    assert pose == pytest.approx(at(11 * PERIOD * SPEED))


def test_what_scans_have_shown_since_then_is_not_reduced():
    extrapolator, distance, time = driven([SPEED] * 6 + [0.1 * SPEED])
    matched = at(distance + 0.05)
    shown = compose(matched, Pose(2.0, 0.0, 0.0))
    missed = tuple((0.9 * SPEED * ALONG).tolist())
    assert extrapolator.since_slip(time + PERIOD, matched, shown, missed) == shown


def test_after_a_slip_the_robot_goes_on_at_its_own_speed():
    extrapolator, distance, time = driven([SPEED] * 6 + [1.8 * SPEED] * 4)
    time += PERIOD
    pose = at(distance - 4 * PERIOD * 0.8 * SPEED + PERIOD * SPEED)
    extrapolator.add_odometry(time, at(distance + PERIOD * 1.8 * SPEED))
    seen = WALLS._replace(is_determined=True)
    missed = tuple((-0.8 * SPEED * ALONG).tolist())

    extrapolator.add_pose(time, pose, evidence=seen, missed_velocity=missed)
    extrapolator.add_odometry(time + PERIOD, at(distance + 2 * PERIOD * 1.8 * SPEED))
    prediction = extrapolator.predict(time + PERIOD)

    assert not prediction.by_odometry
    assert prediction.tf_local_tracking == pytest.approx(
        compose(pose, Pose(PERIOD * SPEED, 0.0, 0.0)), abs=0.02
    )


def test_steps_before_a_slip_do_not_end_it():
    trust, pose = OdometryTrust(), at(0.0)
    seen = WALLS._replace(is_determined=True)
    step = Pose(PERIOD * SPEED, 0.0, 0.0)

    def add(number, said):
        nonlocal pose
        pose = compose(pose, step)
        trust.add(PERIOD * number, pose, said, seen, lambda *_: False, True)

    trust.add(0.0, pose, None, seen, lambda *_: False, True)
    for k in range(1, 7):
        add(k, step)
    trust.note_slip(3.0, step, Pose(0.9, 0.0, 0.0))
    add(7, step)
    assert not trust.is_trusted
    assert [fault.kind for fault in trust.faults] == ["moves too far"]
    for k in range(8, 14):
        add(k, step)
    assert trust.is_trusted


def places_found(reported, sigma=0.01, cupboards=CUPBOARDS, **known):
    """Return what is found as the robot moves by 0.5 m from scan to scan, and its wheels do not."""
    rng, wall_step = np.random.default_rng(0), WallStep(WallStepConfig())
    pose, found = IDENTITY, []
    for k in range(7):
        returns = corridor_scan(0.5 * k, rng, cupboards, sigma=sigma)
        better = wall_step.better_pose(0.5 * k, pose, returns, by_odometry=True, **known)
        found.append(better)
        pose = better or pose
        wall_step.add(0.5 * k, pose, IDENTITY, returns)
        pose = Pose(pose.x + reported, 0.0, 0.0)
    return found


def test_a_noisy_scanner_shows_that_wheels_slip():
    """Noise determines the match, so that it is not known to follow the wheels."""
    assert not any(places_found(0.15, sigma=0.03, match_ratio=0.07))
    found = places_found(0.15, sigma=0.03, match_ratio=0.07, noise=lambda: 0.03)
    assert found[-1].x - found[-2].x == pytest.approx(0.5, abs=0.1)


def test_wheels_that_spin_are_contradicted():
    """They report nearly a metre from scan to scan."""
    found = places_found(0.95, cupboards=(6.0, 7.5, 12.0, 14.0))
    assert found[-1].x == pytest.approx(3.0, abs=0.1)


def test_the_noise_of_a_scan_is_that_at_its_ranges():
    scanner = Scanner.of(LocalSlamConfig())
    returns = np.column_stack((np.linspace(1.0, 5.0, 41), np.zeros(41)))
    assert scanner.noise_of(returns, 0.5) == 0.0
    scanner.noise = Noise(0.0, 0.01)
    assert scanner.noise_of(returns, 0.5) == pytest.approx(0.03)
    assert scanner.noise_of(returns, 0.8) == pytest.approx(0.042)
    assert scanner.noise_of(returns[:0], 0.5) == 0.0
