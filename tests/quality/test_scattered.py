# SPDX-License-Identifier: Apache-2.0
"""Scans that do not show the same walls from one to the next."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.mapper import Mapper
from cartoloop.quality.verdict import Kind, Severity
from cartoloop.sensor.events import LaserScan, Odometry, ScanGeometry
from cartoloop.sensor.pose import Pose

pytestmark = pytest.mark.slow

GEOMETRY = ScanGeometry(
    angle_min=-1.57, angle_increment=0.035, num_beams=90, range_min=0.1, range_max=30.0
)


def mapped(ranges_of, num_scans=120):
    """Return the map of a robot that drives straight on, given the ranges of each scan."""
    mapper = Mapper()
    for k in range(num_scans):
        mapper.add(Odometry(0.2 * k, 0.2 * k, Pose(0.1 * k, 0.0, 0.0)))
        mapper.add(LaserScan(0.2 * k, 0.2 * k, ranges_of(0.1 * k), GEOMETRY))
    return mapper.finish()


def in_a_room(x):
    """Ranges to the walls of a room that ends at 46 m."""
    angles = GEOMETRY.angle_min + GEOMETRY.angle_increment * np.arange(GEOMETRY.num_beams)
    with np.errstate(divide="ignore"):
        ahead = np.where(np.cos(angles) > 0, (46.0 - x) / np.cos(angles), np.inf)
        aside = 3.0 / np.abs(np.sin(angles))
    return np.minimum(ahead, aside)


def test_random_ranges_are_no_good_map():
    rng = np.random.default_rng(3)
    result = mapped(lambda _: rng.uniform(0.2, 29.0, GEOMETRY.num_beams))
    assert result.quality.verdict == "wrong"
    worst = result.quality.places[0]
    assert (worst.kind, worst.severity) == (Kind.SCATTERED, Severity.WRONG)
    assert "walls" in worst.reason
    assert worst.from_stamp < worst.to_stamp


def test_a_room_is_not_scattered():
    result = mapped(in_a_room)
    assert all(place.kind != Kind.SCATTERED for place in result.quality.places)


def test_only_the_part_that_is_scattered_is_named():
    rng = np.random.default_rng(4)
    noise = rng.uniform(0.2, 29.0, (400, GEOMETRY.num_beams))
    result = mapped(lambda x: in_a_room(x) if x < 15.0 else noise[round(10.0 * x)], 400)
    scattered = [place for place in result.quality.places if place.kind == Kind.SCATTERED]
    assert scattered
    assert all(place.to_stamp > 0.2 * 150 for place in scattered)
