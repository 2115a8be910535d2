# SPDX-License-Identifier: Apache-2.0
"""A place is claimed when every other one is refuted, and not before."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.localisation.decision import MARGIN_OF_PATH, MARGIN_OF_SCAN, decide, needed_margin
from cartoloop.localisation.trail import Trail
from cartoloop.sensor.pose import IDENTITY, Pose
from tests.localisation.rooms import BOX, ROOM, START, apart, known_map, points


def composite_of(polygons, pose):
    trail = Trail()
    trail.add(IDENTITY, points(polygons, pose), IDENTITY)
    return trail.composite(0.0)


@pytest.mark.parametrize("pose", [START, Pose(7.5, 8.0, -2.0), Pose(2.0, 4.5, 3.1)])
def test_a_distinct_place_is_claimed_from_one_scan(pose):
    decision = decide(known_map(ROOM), composite_of(ROOM, pose), 0.0)

    distance, angle = apart(pose, decision.claim.tf_map_tracking)
    assert distance < 0.05
    assert angle < 0.5
    assert decision.places == ()


def test_both_places_of_a_symmetrical_room_are_listed():
    decision = decide(known_map(BOX), composite_of(BOX, START), 0.0)

    turned = Pose(10.0 - START.x, 7.0 - START.y, START.theta + np.pi)
    assert decision.claim is None
    assert len(decision.places) == 2
    for pose in (START, turned):
        assert min(apart(pose, place.tf_map_tracking)[0] for place in decision.places) < 0.1
    probabilities = [place.probability for place in decision.places]
    assert probabilities == sorted(probabilities, reverse=True)
    assert 0.9 < sum(probabilities) <= 1.0


def test_a_scan_of_another_building_is_claimed_nowhere():
    hall = (((0, 0), (11, 0), (11, 2), (0, 2)), ((5, 0.5), (5.4, 0.5), (5.4, 0.9), (5, 0.9)))

    decision = decide(known_map(ROOM), composite_of(hall, Pose(3.0, 1.0, 0.0)), 0.0)

    assert decision.claim is None


def test_a_scan_of_few_returns_proves_nothing():
    trail = Trail()
    trail.add(IDENTITY, points(ROOM, START)[:10], IDENTITY)

    decision = decide(known_map(ROOM), trail.composite(0.0), 0.0)

    assert decision.claim is None
    assert decision.places == ()


def test_scans_of_a_path_need_less_of_a_margin():
    assert needed_margin(0.0) == MARGIN_OF_SCAN
    assert needed_margin(100.0) == pytest.approx(MARGIN_OF_PATH)
    assert MARGIN_OF_PATH < needed_margin(2.0) < MARGIN_OF_SCAN
