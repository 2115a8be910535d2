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
MEMORY = MatcherMemory(0.31, 12, 5, 3)
WALLS = WallMemory(17.0, 0.6, -0.8, 0.3, -0.4, True, 42.5)


def test_a_match_is_read_as_it_was_recorded():
    match, memory = recorded_match(memoryview(match_record(MATCH, MEMORY)))
    assert (match.tf_submap_scan, match.residual, match.cost) == (Pose(1.0, -2.0, 0.5), 0.25, 7.5)
    np.testing.assert_array_equal(match.information, MATCH.information)
    assert memory == MEMORY


@pytest.mark.parametrize("pose", [None, Pose(0.1, 0.2, math.pi)])
def test_a_wall_step_is_read_as_it_was_recorded(pose):
    assert recorded_wall_step(memoryview(wall_record(pose, WALLS))) == (pose, WALLS)


def test_records_of_another_version_are_refused_in_one_line():
    for read, record in (
        (recorded_match, match_record(MATCH, MEMORY)),
        (recorded_wall_step, wall_record(None, WALLS)),
    ):
        with pytest.raises(InputError, match="another version"):
            read(memoryview(record[:-4]))
