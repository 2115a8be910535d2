# SPDX-License-Identifier: Apache-2.0
"""A place is claimed when every other one is refuted, and not before."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.localisation import decision as decision_module
from cartoloop.localisation.decision import (
    AGREEMENT_OF_TRAIL,
    DISTINCTNESS_OF_TRAIL,
    MARGIN_OF_PATH,
    MARGIN_OF_SCAN,
    MAX_REFUTED_PATH_M,
    decide,
    needed_margin,
    needed_of,
)
from cartoloop.localisation.known_map import known_map_of_image
from cartoloop.localisation.trail import Trail
from cartoloop.sensor.pose import IDENTITY, Pose
from tests.localisation.rooms import BOX, ROOM, START, apart, known_map, points
from tests.localisation.rooms import image as room_image


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


@pytest.fixture(scope="module")
def twins():
    """A map of two equal rooms, the second mapped less sharply, and the shift to it."""
    shift = 8.5
    second = tuple(tuple((x + shift, y) for x, y in polygon) for polygon in ROOM)
    image = room_image((*ROOM, *second))
    occupancy = image.occupancy
    is_wall = (occupancy == 1.0) & (np.arange(occupancy.shape[1]) * 0.05 > 9.25)
    occupancy[is_wall & (np.random.default_rng(0).random(occupancy.shape) < 0.15)] = 0.0
    return known_map_of_image(image), shift


def test_a_place_mapped_less_sharply_is_not_refuted(twins, monkeypatch):
    known, shift = twins
    composite = composite_of(ROOM, START)

    decision = decide(known, composite, 0.0)

    assert decision.claim is None
    found = sorted(place.tf_map_tracking.x for place in decision.places)
    assert found == pytest.approx([START.x, START.x + shift], abs=0.1)
    assert abs(decision.places[0].score - decision.places[1].score) > MARGIN_OF_SCAN
    # By the score alone the sharper room would have been claimed.
    monkeypatch.setattr(decision_module, "FITTING_MARGIN", 0.0)
    assert decide(known, composite, 0.0).claim is not None


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


def test_scans_of_a_path_need_less_agreement():
    known = known_map(ROOM)
    needed = [needed_of(known, path) for path in (0.0, 3.0, 10.0, 30.0)]

    assert [each.score for each in needed] == sorted((e.score for e in needed), reverse=True)
    agreements = [each.agreement for each in needed]
    assert agreements == sorted(agreements, reverse=True)
    assert agreements[-1] == agreements[-2] == AGREEMENT_OF_TRAIL * known.low_agreement
    distinct = [each.distinctness for each in needed]
    assert distinct == sorted(distinct, reverse=True)
    assert distinct[-1] == distinct[-2] == DISTINCTNESS_OF_TRAIL * known.low_distinctness


def test_refuted_claims_make_the_next_one_need_more_path():
    known = known_map(ROOM)

    assert needed_of(known, 0.5, num_refuted=1) is None
    assert needed_of(known, 3.0, num_refuted=1) == needed_of(known, 3.0)
    assert needed_of(known, 3.0, num_refuted=2) is None
    assert needed_of(known, MAX_REFUTED_PATH_M, num_refuted=99) is not None


def test_a_place_is_listed_but_not_claimed_after_refuted_claims():
    decision = decide(known_map(ROOM), composite_of(ROOM, START), 0.0, num_refuted=1)

    assert decision.claim is None
    assert apart(START, decision.places[0].tf_map_tracking)[0] < 0.1
