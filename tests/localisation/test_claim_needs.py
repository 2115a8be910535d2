# SPDX-License-Identifier: Apache-2.0
"""Longer paths prove a place with less; blurred maps are made up for by details."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.localisation.claim_needs import (
    AGREEMENT_OF_TRAIL,
    DETAILED_PATH_M,
    DETAILED_SCORE,
    DISTINCTNESS_OF_TRAIL,
    MARGIN_OF_PATH,
    MARGIN_OF_SCAN,
    MAX_REFUTED_PATH_M,
    MIN_DETAIL,
    MIN_REFUTING_DETAIL,
    MOST_SCORE,
    PLAIN_DETAIL,
    PLAIN_IMAGE_MARGIN,
    PLAIN_IMAGE_SCORE,
    SCORE_OF_SCAN,
    SCORE_SPREADS,
    VIEW_M,
    VIEW_PATH_M,
    Detailed,
    Needed,
    is_too_plain,
    least_score,
    needed_margin,
    needed_of,
    searched_score,
    shows_enough,
)
from cartoloop.localisation.fit import Fit
from tests.localisation.rooms import ROOM, known_map


@pytest.fixture
def learnt_map():
    """A map whose own scans have shown how scans fit."""
    known = known_map(ROOM)
    known.has_own_fits = True
    return known


def fit(agreement, distinctness, detail=0.6):
    return Fit(0.5, agreement, distinctness, 1000, detail)


def test_scans_of_a_path_need_less_of_a_margin():
    assert needed_margin(0.0) == MARGIN_OF_SCAN
    assert needed_margin(100.0) == pytest.approx(MARGIN_OF_PATH)
    assert MARGIN_OF_PATH < needed_margin(2.0) < MARGIN_OF_SCAN


def test_straight_walls_alone_must_fit_as_the_maps_own_scans(learnt_map):
    learnt_map.low_score = 0.9 * learnt_map.usual.score
    plain, detailed = fit(1.0, 1.0, 0.9 * PLAIN_DETAIL), fit(1.0, 1.0, PLAIN_DETAIL)

    assert is_too_plain(learnt_map, 0.99 * learnt_map.low_score, plain)
    assert not is_too_plain(learnt_map, learnt_map.low_score, plain)
    assert not is_too_plain(learnt_map, 0.5 * learnt_map.low_score, detailed)


def test_straight_walls_alone_must_fit_an_image_closely():
    image, plain = known_map(ROOM), fit(1.0, 1.0, 0.9 * PLAIN_DETAIL)

    assert is_too_plain(image, 0.99 * PLAIN_IMAGE_SCORE, plain)
    assert not is_too_plain(image, PLAIN_IMAGE_SCORE, plain)
    assert not is_too_plain(image, 0.8, plain, 0.79 - PLAIN_IMAGE_MARGIN)
    assert is_too_plain(image, 0.8, plain, 0.81 - PLAIN_IMAGE_MARGIN)


def test_a_sharp_map_needs_a_higher_score(learnt_map):
    usual = learnt_map.usual.score

    learnt_map.low_score = 0.9 * usual
    least = least_score(learnt_map)
    assert least == pytest.approx((1.0 - 0.1 * SCORE_SPREADS) * usual)
    assert needed_of(learnt_map, 3.0).detailed.score == least
    learnt_map.low_score = 0.999 * usual
    assert least_score(learnt_map) == pytest.approx(MOST_SCORE * usual)
    learnt_map.low_score = 0.5 * usual
    assert needed_of(learnt_map, 3.0).detailed.score == DETAILED_SCORE * usual


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


def test_a_scan_fits_a_sharp_map_as_its_own_scans_do(learnt_map):
    usual = learnt_map.usual.score
    learnt_map.low_score = 0.8 * usual
    assert needed_of(learnt_map, 0.0).score == pytest.approx(SCORE_OF_SCAN * usual)

    of_blurred = [needed_of(learnt_map, path).score for path in (0.0, 1.0, 10.0)]
    learnt_map.low_score = 0.97 * usual
    of_sharp = [needed_of(learnt_map, path).score for path in (0.0, 1.0, 10.0)]

    assert of_sharp[0] == pytest.approx(0.985 * usual)  # the middle between low and usual
    assert of_sharp[1] > of_blurred[1]
    assert of_sharp[2] == pytest.approx(of_blurred[2])


def test_a_view_of_a_small_room_needs_some_path():
    angles = np.linspace(0.0, 6.0, 100)
    room = 0.6 * VIEW_M * np.column_stack((np.cos(angles), np.sin(angles)))
    through_a_gap, through_a_door = room.copy(), room.copy()
    through_a_gap[:3] *= 2.0
    through_a_door[:10] *= 2.0

    assert [shows_enough(room, path) for path in (0.0, 0.3 * VIEW_PATH_M)] == [False, False]
    assert shows_enough(room, 0.5 * VIEW_PATH_M)
    assert shows_enough(0.01 * room, VIEW_PATH_M)
    assert not shows_enough(through_a_gap, 0.0)
    assert shows_enough(through_a_door, 0.0)


def test_refuted_claims_make_the_next_one_need_more_path():
    known = known_map(ROOM)

    assert needed_of(known, 0.5, num_refuted=1) is None
    assert needed_of(known, 3.0, num_refuted=1) == needed_of(known, 3.0)
    assert needed_of(known, 3.0, num_refuted=2) is None
    assert needed_of(known, MAX_REFUTED_PATH_M, num_refuted=99) is not None


DETAILED = Detailed(score=0.45, low_agreement=0.9, low_distinctness=0.85, total=1.95)
NEEDED = Needed(
    score=0.7,
    agreement=0.9,
    distinctness=0.85,
    plausible_agreement=0.86,
    plausible_distinctness=0.75,
    detailed=DETAILED,
)


@pytest.mark.parametrize(
    ("agreement", "distinctness", "may_be"),
    [(0.91, 0.86, True), (0.87, 0.76, True), (0.85, 0.86, False), (0.91, 0.74, False)],
)
def test_a_place_may_be_right_that_could_not_be_claimed(agreement, distinctness, may_be):
    there = fit(agreement, distinctness, detail=0.0)

    assert NEEDED.may_be(there) is may_be
    assert NEEDED.fits(there) is (agreement > 0.9 and distinctness > 0.85)


def test_agreement_in_details_makes_up_for_a_low_score():
    agreeing = fit(0.9, 0.85)

    assert NEEDED.are_reached(0.5, agreeing)
    assert not NEEDED.are_reached(0.4, agreeing)
    assert not NEEDED._replace(detailed=None).are_reached(0.5, agreeing)


def test_straight_walls_do_not_make_up_for_a_low_score():
    corridor = fit(0.95, 0.9, detail=0.9 * MIN_DETAIL)

    assert not NEEDED.are_reached(0.5, corridor)
    assert NEEDED.are_reached(0.7, corridor)


@pytest.mark.parametrize(("agreement", "distinctness"), [(0.86, 1.0), (1.0, 0.75), (0.88, 0.8)])
def test_a_low_score_needs_both_agreement_and_distinctness(agreement, distinctness):
    assert not DETAILED.fits(fit(agreement, distinctness))


def test_a_place_that_agrees_much_less_is_refuted():
    best = fit(0.9, 0.85)

    assert DETAILED.refutes(best, fit(0.85, 0.7))
    assert not DETAILED.refutes(best, fit(0.88, 0.83))
    # Where the scans agree like this, a sharper place elsewhere proves nothing.
    assert not DETAILED.refutes(fit(1.0, 1.0), fit(0.88, 0.83))


def test_in_an_image_only_what_could_be_claimed_may_be_right(learnt_map):
    ours, image = (needed_of(known, 0.0) for known in (learnt_map, known_map(ROOM)))

    assert ours.plausible_agreement < ours.agreement
    assert math.isinf(image.plausible_agreement)
    assert image.may_be(fit(1.0, 1.0))
    assert not image.may_be(fit(0.99 * image.agreement, 1.0))


def test_straight_walls_refute_no_place():
    other = fit(0.75, 0.6)

    assert DETAILED.refutes(fit(1.0, 1.0, MIN_REFUTING_DETAIL), other)
    assert not DETAILED.refutes(fit(1.0, 1.0, 0.9 * MIN_REFUTING_DETAIL), other)


def test_details_count_on_a_path_in_maps_with_own_scans(learnt_map):
    assert needed_of(learnt_map, 0.9 * DETAILED_PATH_M).detailed is None
    assert needed_of(known_map(ROOM), 5.0).detailed is None
    detailed = [needed_of(learnt_map, path).detailed for path in (DETAILED_PATH_M, 4.0, 10.0)]
    totals = [each.total for each in detailed]
    assert totals == sorted(totals, reverse=True)
    assert totals[0] > totals[-1]
    assert searched_score(learnt_map, 5.0) <= detailed[0].score < searched_score(learnt_map, 0.0)
