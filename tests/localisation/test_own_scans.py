# SPDX-License-Identifier: Apache-2.0
"""What a map's own scans show."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.localisation.fit import MIN_GLASS_SCANS, UNKNOWN_WEIGHT, FitJudge
from cartoloop.localisation.known_map import known_map_of
from cartoloop.localisation.own_scans import learn_from_own_scans
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.sensor.scan_points import ScanPoints
from tests.localisation.rooms import BOX, ROOM, START, known_map, points
from tests.map_output.small_result import small_result

FENCED = (*ROOM, ((5.5, 1.5), (5.6, 1.5), (5.6, 4.5), (5.5, 4.5)))
"""The room with a fence, which the scans of `ROOM` pass."""


class _OwnScans:
    """The scans of a map at their poses."""

    def __init__(self, poses):
        self.node_points = [points(ROOM, pose) for pose in poses]
        self.graph = self
        self.node_poses = np.array(poses, dtype=np.float64)
        self.node_parts = np.zeros(len(poses), dtype=np.int64)


def poses_of(count):
    return [Pose(START.x - 0.02 * k, START.y + 0.01 * k, 0.05 * k) for k in range(count)]


@pytest.fixture
def judge():
    return FitJudge(known_map(FENCED).cell_grid)


def fit_at(judge, pose):
    return judge.fit(
        ScanPoints.of([points(ROOM, pose)]), np.zeros((1, 2)), np.array([pose], dtype=np.float64)
    )


def test_beams_may_pass_where_the_maps_own_scans_see_through(judge):
    pose = Pose(4.0, 4.0, 1.0)
    before = fit_at(judge, pose)

    learn_from_own_scans(judge, _OwnScans(poses_of(40)))

    assert before.agreement < 0.8
    assert fit_at(judge, pose).agreement > 0.95


def test_the_usual_fit_is_that_of_scans_that_were_left_out(judge):
    own = learn_from_own_scans(judge, _OwnScans(poses_of(8)))  # in a single stretch

    assert own.usual.agreement < 0.8
    assert own.low_agreement <= own.usual.agreement
    assert own.low_distinctness <= own.usual.distinctness


def test_a_map_without_a_scan_that_counts_shows_nothing(judge):
    data = _OwnScans(poses_of(1))
    data.node_poses = np.array([(400.0, 0.0, 0.0)])  # nothing is known there

    assert learn_from_own_scans(judge, data) is None


def test_the_map_of_a_recording_knows_how_scans_fit():
    known = known_map_of(small_result())

    assert 0.0 < known.low_agreement <= known.usual.agreement <= 1.0
    assert 0.0 < known.low_distinctness <= known.usual.distinctness <= 1.0


def test_straight_walls_alone_make_no_distinct_place():
    known = known_map(BOX)
    scan = points(BOX, START)
    scan[::4] *= 0.6  # returns from what stands in the room

    fit = known.fit(scan, IDENTITY, START)

    assert math.isclose(fit.agreement, 0.75, abs_tol=0.02)
    assert fit.distinctness < 0.6


def fit_within_screen(scan, count=MIN_GLASS_SCANS):
    """Return how scans fit in the room with a screen around the robot, which they pass."""
    (x, y), half = START[:2], 0.8
    screen = (
        (x - half, y - half),
        (x + half, y - half),
        (x + half, y + half),
        (x - half, y + half),
    )
    judge = FitJudge(known_map((*ROOM, screen)).cell_grid)
    return judge.fit(ScanPoints.of([scan] * count), np.zeros((count, 2)), np.array([START] * count))


def test_most_beams_of_several_scans_end_behind_glass():
    fit = fit_within_screen(points(ROOM, START))

    assert fit.solid_agreement < 0.5
    assert fit.agreement > 0.95
    assert fit.explained < fit.explained_if_glass <= 1.0


def test_a_single_scan_shows_no_glass():
    fit = fit_within_screen(points(ROOM, START), count=1)

    assert fit.agreement == fit.solid_agreement < 0.5
    assert fit.explained < 0.5
    assert fit.explained_if_glass > 0.95


def test_unknown_returns_are_explained_in_part():
    known = known_map(BOX)
    scan = points(BOX, START)
    scan[: len(scan) // 2] += (400.0, 0.0)  # nothing is known there

    fit = known.fit(scan, IDENTITY, START)

    assert fit.agreement > 0.95
    assert math.isclose(fit.explained, 0.5 + 0.5 * UNKNOWN_WEIGHT, abs_tol=0.03)


def test_beams_that_end_on_floor_show_no_glass():
    scan = points(ROOM, START)
    scan[::4] *= 0.8

    fit = fit_within_screen(scan)

    assert fit.agreement == fit.solid_agreement < 0.5
