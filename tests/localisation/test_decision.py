# SPDX-License-Identifier: Apache-2.0
"""A place is claimed when every other one is refuted, and not before."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.localisation import candidates as candidates_module
from cartoloop.localisation import claim_needs as claim_needs_module
from cartoloop.localisation import decision as decision_module
from cartoloop.localisation.claim_needs import MARGIN_OF_SCAN
from cartoloop.localisation.decision import Before, decide
from cartoloop.localisation.global_search import FoundPlace, Listing
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
    found = sorted(place.tf_map_tracking.x for place in decision.places[:2])
    assert found == pytest.approx([START.x, START.x + shift], abs=0.1)
    assert abs(decision.places[0].score - decision.places[1].score) > MARGIN_OF_SCAN
    # By the score alone the sharper room would have been claimed.
    monkeypatch.setattr(claim_needs_module, "FITTING_MARGIN", 0.0)
    monkeypatch.setattr(decision_module, "FITTING_LESS", -1.0)
    assert decide(known, composite, 0.0).claim is not None


def test_a_place_too_low_to_be_listed_is_not_refuted(twins, monkeypatch):
    known, _ = twins
    composite = composite_of(ROOM, START)
    scores = [place.score for place in decide(known, composite, 0.0).places]
    between = 0.5 * (max(scores) + min(scores))
    monkeypatch.setattr(candidates_module, "searched_score", lambda known, path: between)

    decision = decide(known, composite, 0.0)

    assert decision.claim is None
    assert len(decision.places) == 1
    monkeypatch.setattr(candidates_module, "_lower", lambda *_: iter(()))
    assert decide(known, composite, 0.0).claim is not None


def test_a_scan_alone_does_not_refute_an_equal_score():
    # In the second room a screen stands before the robot, which most beams would pass through.
    second = tuple(tuple((x + 8.5, y) for x, y in polygon) for polygon in ROOM)
    x, y = START.x + 8.5, START.y
    screen = ((x - 0.8, y - 0.8), (x + 0.8, y - 0.8), (x + 0.8, y + 0.8), (x - 0.8, y + 0.8))
    known, composite = known_map((*ROOM, *second, screen)), composite_of(ROOM, START)

    assert decide(known, composite, 0.0).claim is None
    assert apart(START, decide(known, composite, 1.5).claim.tf_map_tracking)[0] < 0.05


def test_a_small_room_is_claimed_after_some_path_only():
    room = tuple(tuple((0.4 * x, 0.4 * y) for x, y in polygon) for polygon in ROOM)
    pose = Pose(0.4 * START.x, 0.4 * START.y, START.theta)
    known, composite = known_map(room), composite_of(room, pose)

    at_first = decide(known, composite, 0.0)

    assert at_first.claim is None
    assert apart(pose, at_first.places[0].tf_map_tracking)[0] < 0.05
    assert apart(pose, decide(known, composite, 2.0).claim.tf_map_tracking)[0] < 0.05


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


def test_a_place_is_listed_but_not_claimed_after_refuted_claims():
    decision = decide(known_map(ROOM), composite_of(ROOM, START), 0.0, Before(num_refuted=1))

    assert decision.claim is None
    assert apart(START, decision.places[0].tf_map_tracking)[0] < 0.1


def test_a_place_of_the_search_before_is_refuted_as_well(twins, monkeypatch):
    known, shift = twins
    composite = composite_of(ROOM, START)
    # The sharper room alone is listed, as if the score of the other had become too low.
    listed = candidates_module.list_places

    def first_only(*arguments):
        places = listed(*arguments)
        return places._replace(places=places.places[:1])

    monkeypatch.setattr(candidates_module, "list_places", first_only)
    assert decide(known, composite, 0.0).claim is not None

    other = Pose(START.x + shift + 0.05, START.y, START.theta)
    assert decide(known, composite, 0.0, Before(places=[other])).claim is None
    same = Pose(START.x + 0.05, START.y, START.theta)
    assert decide(known, composite, 0.0, Before(places=[same])).claim is not None
    assert decide(known, composite, 0.0, Before(kept=[other])).claim is None


def test_a_place_is_refuted_where_the_scan_fits_best_near_it(monkeypatch):
    # Two equal rooms: the search finds the second one a pixel beside where the scan fits.
    second = tuple(tuple((x + 8.5, y) for x, y in polygon) for polygon in ROOM)
    known, composite = known_map((*ROOM, *second)), composite_of(ROOM, START)
    listed = candidates_module.list_places

    def beside(*arguments):
        first, other = listed(*arguments).places[:2]
        x, y, theta = other.tf_map_tracking
        return Listing([first, FoundPlace(Pose(x + 0.06, y, theta), 0.5 * first.score)], True)

    monkeypatch.setattr(candidates_module, "list_places", beside)

    assert decide(known, composite, 0.0).claim is None


def test_a_part_of_the_path_does_not_outvote_all_of_it():
    composite = composite_of(ROOM, START)

    assert decide(known_map(ROOM), composite, 5.0).claim is not None
    assert decide(known_map(ROOM), composite, 5.0, Before(is_undecided=True)).claim is None


def box(x, y, edge):
    return ((x, y), (x + edge, y), (x + edge, y + edge), (x, y + edge))


def test_the_only_place_in_an_image_is_claimed_on_a_path(monkeypatch):
    shelves = [(1.1 + k, 1.1) for k in range(8)] + [(8.4, 1.7 + 1.1 * k) for k in range(7)]
    shelves += [(1.1 + 0.9 * k, 5.4) for k in range(5)] + [(6.1, 6.2 + 0.95 * k) for k in range(4)]
    shelves += [(1.1, 2.1 + 1.05 * k) for k in range(3)] + [(6.6, 9.4), (7.5, 9.4)]
    furnished = (*ROOM, *(box(x, y, 0.5) for x, y in shelves))
    # The image does not show a cupboard beside the robot.
    seen = (*furnished, box(START.x + 0.6, START.y + 0.3, 0.5))
    known, composite = known_map(furnished), composite_of(seen, START)

    at_first, later = (decide(known, composite, path) for path in (0.0, 2.0))

    assert at_first.claim is None
    assert apart(START, later.claim.tf_map_tracking)[0] < 0.05
    assert later.claim.agreement == pytest.approx(0.84, abs=0.02)
    assert decide(known, composite, 2.0, Before(is_undecided=True)).claim is None
    monkeypatch.setattr(decision_module, "IMAGE_COUNTED_SHARE", 1.01)
    assert decide(known, composite, 2.0).claim is None


def test_one_of_two_equal_places_in_an_image_is_not_claimed():
    assert decide(known_map(BOX), composite_of(BOX, START), 5.0).claim is None
