# SPDX-License-Identifier: Apache-2.0
"""Matches and wall steps as records of a journal."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.errors import InputError
from cartoloop.local_slam.match_records import (
    MatcherMemory,
    WallMemory,
    match_record,
    recorded_match,
    recorded_wall_step,
    wall_record,
)
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import Pose

MATCH = LeastSquaresMatch(Pose(1.0, -2.0, 0.5), np.diag((3.0, 4.0, 5.0)), 0.25, 7.5, 6)
MEMORY = MatcherMemory(0.31, 12, 5, 3, None)
WALLS = WallMemory(17.0, 0.6, -0.8, 0.3, -0.4, True, 42.5)


@pytest.mark.parametrize("place", [None, Pose(0.3, -0.4, 2.1)])
@pytest.mark.parametrize("is_relocated", [False, True])
def test_a_match_is_read_as_it_was_recorded(place, is_relocated):
    before = MEMORY._replace(tf_found_predicted=place)
    record = match_record(MATCH, before, is_relocated=is_relocated)
    match, memory, was_relocated = recorded_match(memoryview(record))
    assert (match.tf_submap_scan, match.residual, match.cost) == (Pose(1.0, -2.0, 0.5), 0.25, 7.5)
    np.testing.assert_array_equal(match.information, MATCH.information)
    assert memory == before
    assert was_relocated == is_relocated


@pytest.mark.parametrize("pose", [None, Pose(0.1, 0.2, math.pi)])
def test_a_wall_step_is_read_as_it_was_recorded(pose):
    assert recorded_wall_step(memoryview(wall_record(pose, WALLS))) == (pose, WALLS)


def test_records_of_another_version_are_refused_in_one_line():
    for read, record in (
        (recorded_match, match_record(MATCH, MEMORY, is_relocated=False)),
        (recorded_wall_step, wall_record(None, WALLS)),
    ):
        with pytest.raises(InputError, match="another version"):
            read(memoryview(record[:-4]))
