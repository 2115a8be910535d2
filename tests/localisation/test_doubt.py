# SPDX-License-Identifier: Apache-2.0
"""Doubt grows where scans contradict the map, by path and by time."""

from __future__ import annotations

import math

from cartoloop.localisation.doubt import PROOF_M, Doubt

LOW = 0.8


def proved(low=LOW):
    """Return the doubt after a path that has proved the pose."""
    doubt = Doubt(low)
    doubt.add(0.9, PROOF_M, 0.1)
    return doubt


def steps_until_lost(agreement, path, duration):
    doubt = proved()
    for step in range(1, 1000):
        doubt.add(agreement, path, duration)
        if doubt.is_lost:
            return step
    return None


def test_a_wrong_place_is_lost_within_metres_or_seconds():
    assert steps_until_lost(0.3, 0.1, 0.1) * 0.1 <= 3.0
    assert steps_until_lost(0.3, 0.0, 0.1) * 0.1 <= 5.0


def test_moved_furniture_does_not_make_a_robot_lost():
    assert steps_until_lost(0.7, 0.1, 0.1) is None
    assert steps_until_lost(math.nan, 0.1, 0.1) is None


def doubt_after(agreements):
    doubt = proved(low=1.0)
    for agreement in agreements:
        doubt.add(agreement, 0.1, 0.1)
    return doubt


def test_a_changed_room_does_not_make_a_robot_lost():
    gradual = [0.9, 0.8, 0.7, 0.6, *(0.5 for _ in range(80))]

    assert doubt_after(gradual).is_lost
    assert not doubt_after([0.95] * 100 + gradual).is_lost


def test_a_robot_carried_away_is_lost_after_any_path():
    carried = [0.3] * 15  # 1.5 m

    assert doubt_after([0.95] * 10 + carried).is_lost
    assert doubt_after([0.95] * 1000 + carried).is_lost


def test_a_place_much_alike_is_lost_after_a_sudden_fall():
    alike = [0.55] * 30  # 3 m

    assert doubt_after([0.95] * 100 + alike).is_lost
    assert not doubt_after([0.95] * 100 + [0.8, 0.7] + alike).is_lost


def test_a_fall_is_forgotten_when_scans_agree_again():
    before, after = [0.95] * 100, [0.8, 0.7, *[0.55] * 30]

    assert not doubt_after([*before, 0.5, 0.95, *after]).is_lost


def test_people_passing_by_are_forgotten():
    doubt = Doubt(LOW)
    for _ in range(3):
        doubt.add(0.2, 0.1, 0.1)
    before = doubt.level
    for _ in range(10):
        doubt.add(1.0, 0.1, 0.1)

    assert before > 0.0
    assert doubt.level == 0.0


def test_a_search_that_finds_no_better_place_halves_the_doubt():
    doubt = Doubt(LOW)
    doubt.add(0.0, 1.0, 0.0)
    before = doubt.level
    doubt.reduce()

    assert doubt.level == 0.5 * before


def test_a_claim_is_dropped_where_it_does_not_prove_itself():
    followed, claimed = proved(), Doubt(LOW)
    for _ in range(20):
        for doubt in (followed, claimed):
            doubt.add(LOW - 0.1, 0.1, 0.1)

    assert claimed.is_lost
    assert not claimed.is_proved
    assert not followed.is_lost


def test_a_user_is_believed_longer_than_a_claim():
    given, claimed = Doubt(LOW, is_given=True), Doubt(LOW)
    metres = []
    for doubt in (claimed, given):
        steps = 0
        while not doubt.is_lost:
            doubt.add(LOW - 0.1, 0.1, 0.1)
            steps += 1
        metres.append(0.1 * steps)

    assert metres[0] < 2.0 < metres[1] < PROOF_M


def test_a_claim_is_proved_after_a_path_that_agrees():
    doubt = Doubt(LOW)
    doubt.add(1.0, 0.1 + PROOF_M, 0.1)

    assert doubt.is_proved
    assert not doubt.is_lost


def test_an_outdated_map_is_noticed_in_the_end():
    assert 5.0 < steps_until_lost(0.63, 0.1, 0.1) * 0.1 <= 40.0


def test_what_moves_does_not_disprove_a_claim():
    doubt, of_all = Doubt(LOW), Doubt(LOW)
    for _ in range(100):
        doubt.add(0.7, 0.1, 0.1, standing=0.95)
        of_all.add(0.7, 0.1, 0.1)
    assert of_all.is_lost
    assert not doubt.is_lost


def test_what_stands_decides_nothing_else():
    doubt = Doubt(LOW)
    for _ in range(100):
        doubt.add(0.2, 0.1, 0.1, standing=0.95)
    assert doubt.is_lost


def test_a_proof_begins_again_where_the_whole_path_fits():
    doubt, unproved = Doubt(LOW), Doubt(LOW)
    for _ in range(16):
        for each in (doubt, unproved):
            each.add(LOW - 0.1, 0.1, 0.1)
        if doubt.lacks_proof:
            doubt.restart_proof()
    assert unproved.is_lost
    assert not doubt.is_lost
    assert not doubt.is_proved


def test_a_robot_that_was_carried_away_lacks_more_than_proof():
    doubt = Doubt(LOW)
    for _ in range(10):
        doubt.add(0.1, 0.5, 0.5)
    assert doubt.is_lost
    assert not doubt.lacks_proof
