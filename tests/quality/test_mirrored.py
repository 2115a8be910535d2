# SPDX-License-Identifier: Apache-2.0
"""Maps that may be mirror images."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cartoloop.config import Config
from cartoloop.evaluation.trajectories import absolute_trajectory_error
from cartoloop.mapper import Mapper
from cartoloop.quality.odometry_use import turns_against
from cartoloop.quality.verdict import Kind
from cartoloop.report import sensor_warnings
from cartoloop.sensor.events import LaserScan, Odometry
from cartoloop.sensor.pose import Pose
from cartoloop.simulation import make_world, simulate

pytestmark = pytest.mark.slow


def mapped(events, **sensor):
    mapper = Mapper(Config(sensor=sensor))
    for event in events:
        mapper.add(event)
    return mapper.finish()


@pytest.fixture(scope="module")
def mirrored_events():
    """A drive whose scanner sends its beams in the other order."""
    recording = simulate(make_world("office"), seed=2, duration=90.0)
    return [
        replace(event, ranges=event.ranges[::-1].copy()) if isinstance(event, LaserScan) else event
        for event in recording.events()
    ]


def test_a_mirrored_map_is_doubtful_and_the_user_is_warned(mirrored_events):
    result = mapped(mirrored_events)

    assert result.quality.verdict in ("doubtful", "wrong")
    (place,) = [place for place in result.quality.places if place.kind == Kind.MIRRORED]
    assert "sensor.upside_down=true" in place.advice
    assert place.radius > 2.0
    (warning, *_) = sensor_warnings(result.report)
    assert "mirror image" in warning


def test_odometry_of_the_wrong_sign_is_left_out():
    recording = simulate(make_world("office"), seed=2, duration=120.0)
    flipped = [
        replace(event, tf_odom_tracking=_mirrored(event.tf_odom_tracking))
        if isinstance(event, Odometry)
        else event
        for event in recording.events()
    ]

    result = mapped(flipped)

    errors = absolute_trajectory_error(result.trajectory, recording.true_poses)
    assert errors.mean() < 0.1
    assert [place.kind for place in result.quality.places if place.severity != "minor"] == [
        Kind.MIRRORED
    ]


def _mirrored(pose):
    return Pose(pose.x, -pose.y, -pose.theta)


def test_the_beams_of_a_scanner_upside_down_are_mirrored(mirrored_events):
    result = mapped(mirrored_events, upside_down=True)

    assert result.quality.verdict == "good"
    assert result.report.extra["odometry"]["turn_ratio"] == pytest.approx(1.0, abs=0.2)
    assert not any("mirror" in line for line in sensor_warnings(result.report))


@pytest.mark.parametrize(
    ("odometry", "is_against"),
    [
        (None, False),
        ({}, False),
        ({"turn_ratio": None}, False),
        ({"turn_ratio": 0.9}, False),
        ({"turn_ratio": 0.0}, False),
        ({"turn_ratio": -1.0}, True),
    ],
)
def test_what_is_not_known_is_not_against_the_map(odometry, is_against):
    assert turns_against(odometry) is is_against
