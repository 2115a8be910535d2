# SPDX-License-Identifier: Apache-2.0
"""Scans of a bent path fit in the right place if each is matched there, and not in others."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.localisation import followed_place, image_claims
from cartoloop.localisation.decision import Before, decide
from cartoloop.localisation.followed_place import (
    FITTING_PATH_M,
    FULL_M,
    KEPT_SUM,
    MAX_SCANS_M,
    SCAN_M,
    SUM_OF_PATH,
    SUM_OF_SCAN,
    fits_along,
    follow_best,
    follow_in,
    has_rival,
    is_proved,
    needed_sum,
    refuting_sum,
    sum_of,
)
from cartoloop.localisation.global_search import fit_of_composite
from cartoloop.localisation.image_claims import is_proved_in_image
from cartoloop.localisation.trail import Trail
from cartoloop.sensor.pose import IDENTITY, Pose, compose, relative
from tests.localisation.rooms import BOX, ROOM, apart, drive, known_map, points

PATH_M = 2.4
TRUTH = drive(Pose(3.0, 5.0, 0.1), 8, step=PATH_M / 8)
NEWEST = TRUTH[-1]


def path_of(polygons, truth, bend=0.0, places=None):
    """Return the scans at poses, which local motion bends by an angle [deg] from scan to scan."""
    trail, local = Trail(), IDENTITY
    for before, pose in zip((truth[0], *truth), truth, strict=False):
        local = compose(compose(local, relative(before, pose)), Pose(0, 0, math.radians(bend)))
        trail.add(local, points(polygons, pose), IDENTITY)
    return trail.composite(10.0)


@pytest.fixture(scope="module")
def known():
    """The room, as if its usual fit had been learnt from scans of its own."""
    room = known_map(ROOM)
    scans = path_of(ROOM, TRUTH)
    room.usual = fit_of_composite(room, scans, NEWEST)
    room.low_agreement, room.low_distinctness = 0.97, 0.95
    room.has_own_fits = True
    return room


@pytest.fixture(scope="module")
def bent():
    return path_of(ROOM, TRUTH, bend=1.5)


def test_scans_of_a_bent_path_fit_where_each_is_matched(known, bent):
    moved_as_one = fit_of_composite(known, bent, NEWEST)

    followed = follow_in(known, bent, NEWEST)

    assert len(followed.poses) == len(TRUTH)
    for pose, truth in zip(followed.poses, reversed(TRUTH), strict=True):
        distance, angle = apart(truth, pose)
        assert distance < 0.03
        assert angle < 0.5
    assert moved_as_one.score < 0.85 * known.usual.score
    assert followed.fit.score > 0.95 * known.usual.score
    assert followed.total == sum_of(known, followed.fit)


def test_scans_hardly_fit_better_in_a_wrong_place(known, bent):
    wrong = Pose(NEWEST.x - 0.5, NEWEST.y - 0.4, NEWEST.theta + math.pi)

    assert follow_in(known, bent, wrong).total < KEPT_SUM


def test_scans_of_few_returns_are_moved_on_by_local_motion(known):
    trail = Trail()
    for pose, count in zip(TRUTH[:3], (180, 5, 180), strict=True):
        trail.add(relative(TRUTH[0], pose), points(ROOM, pose)[:count], IDENTITY)

    poses = follow_in(known, trail.composite(10.0), TRUTH[2]).poses

    assert apart(TRUTH[1], poses[1])[0] < 0.03
    assert relative(Pose(*poses[0]), Pose(*poses[1])) == pytest.approx(
        relative(TRUTH[2], TRUTH[1]), abs=0.02
    )


def test_the_best_of_many_places_comes_first_and_once(known, bent):
    near = Pose(NEWEST.x + 0.04, NEWEST.y - 0.03, NEWEST.theta)
    wrong = Pose(NEWEST.x - 0.5, NEWEST.y - 0.4, NEWEST.theta + math.pi)

    followed = follow_best(known, bent, [wrong, near, NEWEST])

    assert len(followed) == 1
    assert apart(NEWEST, followed[0].pose)[0] < 0.03


def test_a_place_is_proved_only_if_no_other_fits_as_well(known, bent):
    followed = follow_best(known, bent, [NEWEST])
    best = followed[0]
    rival = best._replace(poses=best.poses + np.array((2.0, 2.0, 0.0)), total=best.total - 0.1)

    assert is_proved(known, bent, PATH_M, followed, [], [])
    assert not is_proved(known, bent, PATH_M, [*followed, rival], [], [])
    assert is_proved(known, bent, PATH_M, followed, [NEWEST], [NEWEST])


def test_along_straight_walls_a_lower_score_refutes(known, bent):
    best = follow_best(known, bent, [NEWEST])[0]
    bare, lower = 0.4 * best.fit.detail, best.fit.score - 0.1

    def rival(**fit):
        elsewhere = best.poses + np.array((2.0, 2.0, 0.0))
        return best._replace(poses=elsewhere, fit=best.fit._replace(**fit))

    assert is_proved(known, bent, PATH_M, [best, rival(detail=bare, score=lower)], [], [])
    assert not is_proved(known, bent, PATH_M, [best, rival(detail=bare)], [], [])
    assert not is_proved(known, bent, PATH_M, [best, rival(score=lower)], [], [])


def test_a_place_that_explains_less_is_no_rival(known, bent):
    best = follow_best(known, bent, [NEWEST])[0]
    explained, if_glass = best.fit.explained, best.fit.explained_if_glass

    def is_alone(lower, *, less=0.0, less_if_glass=0.0, path=PATH_M, **fit):
        fit |= {"explained": explained - less, "explained_if_glass": if_glass - less_if_glass}
        rival = best._replace(
            poses=best.poses + np.array((2.0, 2.0, 0.0)),
            fit=best.fit._replace(**fit),
            total=best.total - lower,
        )
        return is_proved(known, bent, path, [best, rival], [], [])

    assert is_alone(0.12, less=0.04, less_if_glass=0.04)
    assert not is_alone(0.12, less=0.04)
    assert not is_alone(0.12, less_if_glass=0.04)
    assert not is_alone(0.08, less=0.04, less_if_glass=0.04)
    assert not is_alone(0.12, less=0.04, less_if_glass=0.04, path=1.2)


def test_a_short_path_refutes_less():
    sums = [refuting_sum(path) for path in (0.0, 0.5 * FULL_M, FULL_M, 2.0 * FULL_M)]

    assert sums == pytest.approx([0.4, 0.325, 0.25, 0.25])


def test_a_low_score_proves_no_place(known, bent, monkeypatch):
    followed = follow_best(known, bent, [NEWEST])
    score = followed[0].fit.score

    monkeypatch.setattr(followed_place, "least_score", lambda _: score - 0.01)
    assert is_proved(known, bent, PATH_M, followed, [], [])
    monkeypatch.setattr(followed_place, "least_score", lambda _: score + 0.01)
    assert not is_proved(known, bent, PATH_M, followed, [], [])


def in_a_box():
    """Return a room that looks the same turned by half, scans in it, and both of their places."""
    box = known_map(BOX)
    truth = drive(Pose(3.0, 3.0, 0.1), 8, step=0.3)
    scans = path_of(BOX, truth, bend=0.4)
    box.usual = fit_of_composite(box, path_of(BOX, truth), truth[-1])
    box.low_agreement, box.low_distinctness, box.has_own_fits = 0.97, 0.9, True
    turned = Pose(10.0 - truth[-1].x, 7.0 - truth[-1].y, truth[-1].theta + math.pi)
    return box, scans, truth[-1], turned


def test_other_places_are_followed_before_one_is_proved():
    box, scans, newest, turned = in_a_box()
    followed = follow_best(box, scans, [newest])

    assert is_proved(box, scans, PATH_M, followed, [], [])
    assert not is_proved(box, scans, PATH_M, followed, [], [turned])
    lower = followed[0].fit._replace(score=followed[0].fit.score - 0.1)
    outscored = [followed[0]._replace(fit=lower)]
    assert is_proved(box, scans, PATH_M, outscored, [], [])
    assert not is_proved(box, scans, PATH_M, outscored, [turned], [])


def test_a_place_that_is_built_alike_is_a_rival(known, bent):
    box, scans, newest, turned = in_a_box()
    # moved as one, the scans fit less in it
    turned = compose(turned, Pose(0.05, 0.05, 0.02))
    wrong = Pose(NEWEST.x - 0.5, NEWEST.y - 0.4, NEWEST.theta + math.pi)

    assert has_rival(box, scans, PATH_M, newest, [turned])
    assert not has_rival(box, scans, PATH_M, newest, [newest])
    assert not has_rival(known, bent, PATH_M, NEWEST, [wrong])
    box.has_own_fits = False
    assert not has_rival(box, scans, PATH_M, newest, [turned])


def test_nothing_is_proved_in_a_map_without_own_scans(bent):
    foreign = known_map(ROOM)
    followed = follow_best(foreign, bent, [NEWEST])

    assert followed[0].total > needed_sum(PATH_M, len(TRUTH))
    assert not is_proved(foreign, bent, PATH_M, followed, [], [])


def test_in_an_image_the_place_that_explains_most_is_proved(bent):
    foreign = known_map(ROOM)
    best = follow_best(foreign, bent, [NEWEST])[0]
    best = best._replace(fit=best.fit._replace(detail=0.41))

    def rival(less):
        fit = best.fit._replace(
            explained=best.fit.explained - less,
            explained_if_glass=best.fit.explained_if_glass - less,
        )
        elsewhere = best.poses + np.array((2.0, 2.0, 0.0))
        return best._replace(poses=elsewhere, fit=fit, total=best.total - 0.2)

    def is_alone(followed, path=PATH_M, others=()):
        return is_proved_in_image(foreign, bent, path, followed, others)

    assert is_alone([best, rival(0.08)])
    assert not is_alone([best, rival(0.06)])
    assert is_alone([best, rival(0.06)], path=FULL_M)
    assert is_alone([best], others=[NEWEST])
    assert not is_alone([best], path=1.4)
    most = int(0.79 * bent.scans.counts.sum())
    for fit in ({"explained": 0.6}, {"detail": 0.39}, {"num_counted": most}):
        assert not is_alone([best._replace(fit=best.fit._replace(**fit))])


def test_in_an_image_straight_walls_prove_less(bent):
    foreign = known_map(ROOM)
    best = follow_best(foreign, bent, [NEWEST])[0]

    def is_alone(explained, detail, agreement=0.84):
        fit = best.fit._replace(agreement=agreement, detail=detail, explained=explained)
        followed = [best._replace(fit=fit)]
        return is_proved_in_image(foreign, bent, PATH_M, followed, [])

    assert is_alone(0.83, 0.78)
    assert not is_alone(0.83, 0.50)
    assert is_alone(0.90, 0.50)
    assert not is_alone(0.79, 0.95, agreement=0.95)


def test_in_an_image_other_places_are_followed(monkeypatch):
    box, scans, newest, turned = in_a_box()
    box.has_own_fits = False
    monkeypatch.setattr(image_claims, "IMAGE_DETAIL", 0.0)
    followed = follow_best(box, scans, [newest])

    assert is_proved_in_image(box, scans, PATH_M, followed, [])
    assert not is_proved_in_image(box, scans, PATH_M, followed, [turned])


def test_a_map_with_own_scans_is_no_image(known, bent):
    followed = follow_best(known, bent, [NEWEST])

    assert not is_proved_in_image(known, bent, PATH_M, followed, [])


def test_newest_scans_that_contradict_forbid_a_claim(known, monkeypatch):
    trail = Trail()
    for k, pose in enumerate(TRUTH):
        seen = ROOM if k < len(TRUTH) - 3 else BOX
        trail.add(relative(TRUTH[0], pose), points(seen, pose), IDENTITY)
    composite = trail.composite(10.0)
    best = follow_best(known, composite, [NEWEST])[0]._replace(total=SUM_OF_SCAN)

    assert not is_proved(known, composite, 10.0, [best], [], [])
    monkeypatch.setattr(followed_place, "NEWEST_SUM", 0.0)
    assert is_proved(known, composite, 10.0, [best], [], [])


def test_a_single_scan_is_not_proved_by_being_matched(known):
    scan = path_of(ROOM, TRUTH[-1:])

    assert not is_proved(known, scan, PATH_M, follow_best(known, scan, [NEWEST]), [], [])


def test_less_is_needed_of_a_longer_path():
    half = 0.5 * FULL_M - 2 * SCAN_M

    assert needed_sum(0.0, 1) == pytest.approx(SUM_OF_SCAN)
    assert needed_sum(half, 3) == pytest.approx(0.5 * (SUM_OF_SCAN + SUM_OF_PATH))
    assert needed_sum(10.0, 40) == pytest.approx(SUM_OF_PATH)


def test_turning_on_the_spot_counts_as_a_short_path():
    turned = needed_sum(0.0, 60)

    assert SUM_OF_PATH < turned < SUM_OF_SCAN
    assert turned == pytest.approx(needed_sum(MAX_SCANS_M, 1))


def test_a_place_that_is_kept_is_followed_from_the_newest_scan(known):
    very_bent = path_of(ROOM, TRUTH, bend=4.0)

    followed = follow_best(known, very_bent, [], [NEWEST])

    assert follow_best(known, very_bent, [NEWEST]) == []
    assert apart(NEWEST, followed[0].pose)[0] < 0.03
    assert apart(TRUTH[0], followed[0].poses[-1])[0] < 0.03


def test_a_bent_path_is_claimed_where_it_is_followed(known):
    very_bent = path_of(ROOM, TRUTH, bend=2.5)

    decision = decide(known, very_bent, PATH_M, Before(kept=[NEWEST]))

    distance, angle = apart(NEWEST, decision.claim.tf_map_tracking)
    assert distance < 0.03
    assert angle < 0.5


def test_places_are_kept_that_the_search_does_not_list(known, monkeypatch):
    monkeypatch.setattr("cartoloop.localisation.candidates.find", lambda *_: None)
    scans = path_of(ROOM, TRUTH, bend=2.5)

    assert decide(known, scans, 0.0).kept == ()
    decision = decide(known, scans, 0.0, Before(num_refuted=1, kept=[NEWEST]))

    assert decision.claim is None
    assert decision.places == ()
    assert len(decision.kept) == 1
    assert apart(NEWEST, decision.kept[0])[0] < 0.03
    assert np.isnan(decision.runner_up)


def test_a_claimed_place_fits_along_the_whole_path(known, bent):
    wrong = Pose(NEWEST.x - 0.5, NEWEST.y - 0.4, NEWEST.theta + math.pi)

    assert fits_along(known, bent, FITTING_PATH_M, NEWEST)
    assert not fits_along(known, bent, FITTING_PATH_M, wrong)


def test_a_short_path_keeps_no_claim(known, bent):
    assert not fits_along(known, bent, 0.9 * FITTING_PATH_M, NEWEST)
    assert not fits_along(known, None, FITTING_PATH_M, NEWEST)
