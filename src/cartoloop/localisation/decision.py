# SPDX-License-Identifier: Apache-2.0
"""What a search of the whole map amounts to: a place that is claimed, several, or none.

A place is claimed if it fits as scans usually fit, and every other place is refuted: by a clearly
lower score, or because beams would pass through walls there, or end on its floor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import chain
from typing import NamedTuple

import numpy as np

from cartoloop.localisation.answer import Place
from cartoloop.localisation.candidates import (
    AGREEMENT_SCALE,
    SCORE_SCALE,
    Candidate,
    Searched,
    refined,
    search,
    unlisted_places,
)
from cartoloop.localisation.claim_needs import (
    FITTING_DETAIL,
    FITTING_LESS,
    Margins,
    Needed,
    is_too_plain,
    margins_of,
    needed_of,
    shows_enough,
)
from cartoloop.localisation.fit import Fit
from cartoloop.localisation.followed_place import (
    MIN_COUNTED_SHARE,
    FollowedPlace,
    follow_best,
    has_rival,
    is_proved,
)
from cartoloop.localisation.global_search import is_same_place
from cartoloop.localisation.image_claims import (
    IMAGE_COUNTED_SHARE,
    is_apart,
    is_proved_in_image,
)
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.trail import Composite
from cartoloop.sensor.pose import Pose

POSSIBLE_AGREEMENT = 0.6
"""Agreement from which places are answered, relative to the usual."""

REFUTING_AGREEMENT = 0.15
"""Places with an agreement lower by this than the best one's are refuted."""

NOWHERE_SCORE = 0.75
"""That the robot is in no listed place is as probable as a place of this score, relative to the
usual one."""

MIN_POINTS = 20
"""Scans with fewer returns are not searched."""


class Claim(NamedTuple):
    """A place that the scans prove.

    Attributes
    ----------
    tf_map_tracking : pose of the newest scan, refined.
    agreement : of the scans, if it is low because of the map; NaN: as usual.
    """

    tf_map_tracking: Pose
    agreement: float = math.nan


class Decision(NamedTuple):
    """What a search amounts to.

    Attributes
    ----------
    claim : the place, or None.
    places : where the robot may be if no place is claimed, the likeliest first.
    runner_up : upper limit of the score of any place but the best; NaN if nothing fits.
    kept : poses in the places where the scans fit if each is matched there, the best first: they
        are looked at in the next search as well, also if nothing is found there.
    """

    claim: Claim | None
    places: tuple[Place, ...]
    runner_up: float
    kept: tuple[Pose, ...] = ()


NOTHING = Decision(None, (), math.nan)
"""No place fits."""


class Before(NamedTuple):
    """What searches before have shown.

    Attributes
    ----------
    num_refuted : claims that the scans refuted soon after, see :func:`needed_of`.
    places : where the robot is now if it was in the places of the search before: they have to be
        refuted as well, also where their scores have become too low to be listed.
    is_undecided : whether more scans fit in several places: fewer prove one only by its details.
    kept : where the robot is now if it was in the places that were kept.
    """

    num_refuted: int = 0
    places: Sequence[Pose] = ()
    is_undecided: bool = False
    kept: Sequence[Pose] = ()


NOTHING_BEFORE = Before()
"""There was no search before."""


def decide(
    known: KnownMap, composite: Composite, path: float, before: Before = NOTHING_BEFORE
) -> Decision:
    """Search scans in the whole map.

    Parameters
    ----------
    path : length of the path that the scans come from [m].
    before : what the searches before have shown.
    """
    if len(composite.points) < MIN_POINTS:
        return NOTHING
    needed = needed_of(known, path, before.num_refuted)
    if not shows_enough(composite.points, path):
        needed = None
    searched = search(known, composite, path)
    if needed is not None and searched.are_all:
        claim = _claim_by_scans(known, composite, path, needed, searched, before)
        if claim is None and not before.is_undecided:
            claim = _claim_apart(known, composite, path, searched)
        if claim is not None:
            return Decision(claim, (), searched.runner_up)
    places = [each.tf_map_tracking for each in searched.candidates]
    followed = follow_best(known, composite, places, before.kept)
    if needed is not None and searched.are_all and not before.is_undecided:
        claim = _claim_by_path(known, composite, path, followed, searched)
        if claim is not None:
            return Decision(claim, (), searched.runner_up)
    kept = tuple(each.pose for each in followed)
    return Decision(None, _places(known, searched.candidates), searched.runner_up, kept)


def _claim_by_scans(
    known: KnownMap,
    composite: Composite,
    path: float,
    needed: Needed,
    searched: Searched,
    before: Before,
) -> Claim | None:
    """Return the best place if the scans, moved as one, fit there as a claim needs it."""
    candidates, rest = searched.candidates, searched.rest
    if not candidates:
        return None
    if before.is_undecided:
        needed = needed._replace(score=math.inf)
    # A search finds a place to a pixel, and how well scans fit changes within one.
    best = refined(known, composite, candidates[0].tf_map_tracking)
    if not (
        _is_known_at(known, composite, candidates[0], best.fit)
        and needed.are_reached(best.score, best.fit)
        and not is_too_plain(known, best.score, best.fit, searched.runner_up)
    ):
        return None
    is_refuted = partial(_is_refuted, best, margins_of(known, path), needed)
    poses = chain(
        (each.tf_map_tracking for each in candidates[1:]),
        (each.tf_map_tracking for each in rest),
        before.places,
        before.kept,
        (each.tf_map_tracking for each in unlisted_places(known, composite, path, searched)),
    )
    others = (refined(known, composite, pose) for pose in poses)
    is_only_place = all(
        is_same_place(other.tf_map_tracking, best.tf_map_tracking) or is_refuted(other)
        for other in others
    )
    if not is_only_place:
        return None
    likely = chain((each.tf_map_tracking for each in candidates[1:]), before.kept)
    if has_rival(known, composite, path, best.tf_map_tracking, likely):
        return None
    return Claim(best.tf_map_tracking)


def _claim_apart(
    known: KnownMap, composite: Composite, path: float, searched: Searched
) -> Claim | None:
    """Return the best place if no other comes near it, in a map without own scans."""
    if known.has_own_fits or not searched.candidates:
        return None
    found = searched.candidates[0]
    best = refined(known, composite, found.tf_map_tracking)
    if not (
        _is_known_at(known, composite, found, best.fit, IMAGE_COUNTED_SHARE)
        and is_apart(known, path, best.score, searched.runner_up, best.fit)
    ):
        return None
    return Claim(best.tf_map_tracking, best.fit.agreement)


def _claim_by_path(
    known: KnownMap,
    composite: Composite,
    path: float,
    followed: Sequence[FollowedPlace],
    searched: Searched,
) -> Claim | None:
    """Return the best place if the scans fit there, each matched, as a claim needs it."""
    if not followed or known.value_at(followed[0].pose) == 0:
        return None
    listed = [place.tf_map_tracking for place in searched.candidates]
    rest = (place.tf_map_tracking for place in searched.rest)
    unlisted = (p.tf_map_tracking for p in unlisted_places(known, composite, path, searched))
    others = chain(rest, unlisted)
    if known.has_own_fits:
        is_proof = is_proved(known, composite, path, followed, listed, others)
        return Claim(followed[0].pose) if is_proof else None
    is_proof = is_proved_in_image(known, composite, path, followed, chain(listed, others))
    return Claim(followed[0].pose, followed[0].fit.agreement) if is_proof else None


def _is_refuted(best: Candidate, margins: Margins, needed: Needed, other: Candidate) -> bool:
    """Return whether the best place fits so much better that the other is none.

    Where the best place needs no glass in the map, the other one is given none either.

    Parameters
    ----------
    needed : for a claim; where the other place agrees like that, it takes more to refute it.
    """
    here, there = best.fit, other.fit
    if needed.fits(here.if_solid):
        here, there = here.if_solid, there.if_solid
    behind = here.agreement - there.agreement
    lower = best.score - other.score
    if needed.may_be(there) and there.detail >= FITTING_DETAIL * here.detail:
        less = behind + here.distinctness - there.distinctness
        return lower >= margins.fitting and less >= FITTING_LESS
    if lower >= margins.other:
        return True
    if not margins.agreement_counts:
        return False
    if behind >= REFUTING_AGREEMENT and lower > -margins.higher:
        return True
    detailed = needed.detailed
    return detailed is not None and lower >= 0.0 and detailed.refutes(here, there)


def _is_known_at(
    known: KnownMap,
    composite: Composite,
    found: Candidate,
    fit: Fit,
    min_share: float = MIN_COUNTED_SHARE,
) -> bool:
    """Return whether the map is known where the robot is in a place, and where its scans end."""
    if known.value_at(found.tf_map_tracking) == 0:
        return False
    return fit.num_counted >= min_share * int(composite.scans.counts.sum())


def _places(known: KnownMap, candidates: list[Candidate]) -> tuple[Place, ...]:
    """Return the candidates that may be right, with their probabilities, the likeliest first."""
    usual = known.usual
    possible = [
        each for each in candidates if each.fit.agreement >= POSSIBLE_AGREEMENT * usual.agreement
    ]
    if not possible:
        return ()
    logs = np.array([each.log_likelihood for each in possible])
    # That the robot is in none of them competes as a place that fits just well enough to be listed.
    nowhere = (
        NOWHERE_SCORE * usual.score / SCORE_SCALE
        + POSSIBLE_AGREEMENT * usual.agreement / AGREEMENT_SCALE
    )
    top = max(float(logs.max()), nowhere)
    weights = np.exp(logs - top)
    weights /= weights.sum() + math.exp(nowhere - top)
    order = np.argsort(-weights, kind="stable").tolist()
    return tuple(
        Place(possible[i].tf_map_tracking, float(weights[i]), possible[i].score) for i in order
    )
