# SPDX-License-Identifier: Apache-2.0
"""What a search of the whole map amounts to: a place that is claimed, several, or none.

A place is claimed if it fits as scans usually fit, and every other place is refuted: by a clearly
lower score, or because beams would pass through walls there, or end on its floor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import chain
from typing import NamedTuple

import numpy as np

from cartoloop.localisation.answer import Place
from cartoloop.localisation.claim_needs import (
    FITTING_DETAIL,
    FITTING_LESS,
    FITTING_MARGIN,
    Needed,
    needed_margin,
    needed_of,
    searched_score,
    shows_enough,
)
from cartoloop.localisation.fit import Fit
from cartoloop.localisation.followed_place import (
    MIN_COUNTED_SHARE,
    FollowedPlace,
    follow_best,
    is_proved,
)
from cartoloop.localisation.global_search import (
    FoundPlace,
    TileMatches,
    find,
    fit_of_composite,
    is_same_place,
    list_places,
    refine,
    runner_up_score,
    search_tiles,
)
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.trail import Composite
from cartoloop.sensor.pose import IDENTITY, Pose

POSSIBLE_AGREEMENT = 0.6
"""Agreement from which places are answered, relative to the usual."""

MAX_PLACES = 12
"""Number of places that are answered, the likeliest."""

REFUTING_AGREEMENT = 0.15
"""Places with an agreement lower by this than the best one's are refuted."""

SCORE_SCALE, AGREEMENT_SCALE = 0.015, 0.04
"""Differences of score and agreement that make a place e times less probable."""

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
    """

    tf_map_tracking: Pose


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


class _Candidate(NamedTuple):
    tf_map_tracking: Pose
    score: float
    fit: Fit

    @property
    def log_likelihood(self) -> float:
        agreement = 0.0 if math.isnan(self.fit.agreement) else self.fit.agreement
        return self.score / SCORE_SCALE + agreement / AGREEMENT_SCALE


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


class _Searched(NamedTuple):
    """Where scans fit.

    Attributes
    ----------
    candidates : the likeliest first.
    rest : other places that are listed, if there are many.
    lowest : score down to which places may be right.
    runner_up : upper limit of the score of any place but the best; NaN without any.
    are_all : whether these are all places down to `runner_up`, or it is low enough.
    """

    candidates: list[_Candidate]
    rest: list[FoundPlace]
    lowest: float
    runner_up: float
    are_all: bool

    @property
    def listed(self) -> list[Pose]:
        """Poses of all places, tf_map_tracking."""
        first = [place.tf_map_tracking for place in self.candidates]
        return first + [place.tf_map_tracking for place in self.rest]


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
    searched = _search(known, composite, path)
    if needed is not None and searched.are_all:
        claim = _claim_by_scans(known, composite, path, needed, searched, before)
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


def _search(known: KnownMap, composite: Composite, path: float) -> _Searched:
    """Return the places where scans fit, moved as one."""
    points = composite.points
    least = searched_score(known, path)
    found = find(known, points, least)
    if found is None:
        return _Searched([], [], least, math.nan, True)
    margin = needed_margin(path)
    lowest = found.score - max(2.0 * margin, FITTING_MARGIN * known.usual.score)
    tiles = search_tiles(known, points, max(lowest, least))
    runner_up = runner_up_score(known, tiles, found)
    listed = list_places(known, points, tiles)
    # Of long lists, the rest matters only if the best place would be claimed.
    first, rest = listed.places[:MAX_PLACES], listed.places[MAX_PLACES:]
    candidates = [_candidate(known, composite, place) for place in first]
    candidates.sort(key=lambda each: -each.log_likelihood)
    are_all = listed.is_complete or found.score - runner_up >= margin
    return _Searched(candidates, rest, lowest, runner_up, are_all)


def _claim_by_scans(
    known: KnownMap,
    composite: Composite,
    path: float,
    needed: Needed,
    searched: _Searched,
    before: Before,
) -> Claim | None:
    """Return the best place if the scans, moved as one, fit there as a claim needs it."""
    candidates, rest = searched.candidates, searched.rest
    if not candidates:
        return None
    if before.is_undecided:
        needed = needed._replace(score=math.inf)
    best = candidates[0]
    claim = _claim(known, composite, best, needed)
    if claim is None:
        return None
    others = chain(
        candidates[1:],
        (_candidate(known, composite, place) for place in rest),
        _earlier(known, composite, before.places, searched.listed),
        _unlisted(known, composite, path, searched),
    )
    margin, fitting_margin = needed_margin(path), FITTING_MARGIN * known.usual.score
    is_refuted = partial(_is_refuted, best, margin, fitting_margin, needed)
    return claim if all(map(is_refuted, others)) else None


def _claim_by_path(
    known: KnownMap,
    composite: Composite,
    path: float,
    followed: Sequence[FollowedPlace],
    searched: _Searched,
) -> Claim | None:
    """Return the best place if the scans fit there, each matched, as a claim needs it."""
    if not followed or known.value_at(followed[0].pose) == 0:
        return None
    rest = (place.tf_map_tracking for place in searched.rest)
    unlisted = (p.tf_map_tracking for p in _unlisted(known, composite, path, searched))
    is_proof = is_proved(known, composite, path, followed, chain(rest, unlisted))
    return Claim(followed[0].pose) if is_proof else None


def _candidate(known: KnownMap, composite: Composite, place: FoundPlace) -> _Candidate:
    fit = fit_of_composite(known, composite, place.tf_map_tracking)
    return _Candidate(place.tf_map_tracking, place.score, fit)


def _earlier(
    known: KnownMap,
    composite: Composite,
    earlier: Sequence[Pose],
    listed: Sequence[Pose],
) -> Iterator[_Candidate]:
    """Yield the places of the search before that are not listed now."""
    for predicted in earlier:
        pose = known.to_map(refine(known, composite.points, predicted).tf_submap_scan)
        if not any(is_same_place(pose, other) for other in listed):
            score = known.fit(composite.points, IDENTITY, pose).score
            yield _candidate(known, composite, FoundPlace(pose, score))


def _unlisted(
    known: KnownMap, composite: Composite, path: float, searched: _Searched
) -> Iterator[_Candidate]:
    """Yield the places that may be right but were too low to be listed."""
    if searched.lowest < searched_score(known, path):
        yield from _lower(known, composite, searched.listed, searched.lowest)


def _lower(
    known: KnownMap,
    composite: Composite,
    listed: Sequence[Pose],
    min_score: float,
) -> Iterator[_Candidate]:
    """Yield the places that reach a score but were too low to be listed.

    Where the map is blurred, the right place may be among them. Of each tile the best is looked at,
    and all places in the tiles whose best is listed: along corridors, a full list takes seconds.
    """

    def is_listed(pose: Pose) -> bool:
        return any(is_same_place(pose, other) for other in listed)

    points = composite.points
    centres, matches, _ = search_tiles(known, points, min_score)
    is_divided = np.zeros(len(matches), dtype=bool)
    for i, match in enumerate(matches):
        if match is not None:
            pose = known.to_map(match.tf_submap_scan)
            is_divided[i] = is_listed(pose)
            if not is_divided[i]:
                yield _candidate(known, composite, FoundPlace(pose, match.score))
    divided = [match for match, is_chosen in zip(matches, is_divided, strict=True) if is_chosen]
    tiles = TileMatches(centres[is_divided], divided, min_score)
    for place in list_places(known, points, tiles).places:
        if not is_listed(place.tf_map_tracking):
            yield _candidate(known, composite, place)


def _is_refuted(
    best: _Candidate, margin: float, fitting_margin: float, needed: Needed, other: _Candidate
) -> bool:
    """Return whether the best place fits so much better that the other is none.

    Parameters
    ----------
    margin, fitting_margin : by which the other's score is lower at least; the second where it fits.
    needed : for a claim; where the other place agrees like that, it takes more to refute it.
    """
    behind = best.fit.agreement - other.fit.agreement
    lower = best.score - other.score
    if needed.fits(other.fit) and other.fit.detail >= FITTING_DETAIL * best.fit.detail:
        less = behind + best.fit.distinctness - other.fit.distinctness
        return lower >= fitting_margin and less >= FITTING_LESS
    if lower >= margin or (behind >= REFUTING_AGREEMENT and lower > -0.5 * margin):
        return True
    detailed = needed.detailed
    return detailed is not None and lower >= 0.0 and detailed.refutes(best.fit, other.fit)


def _claim(known: KnownMap, composite: Composite, best: _Candidate, needed: Needed) -> Claim | None:
    """Return the best place as a claim if the scans fit there as they usually do."""
    if known.value_at(best.tf_map_tracking) == 0:
        return None
    match = refine(known, composite.points, best.tf_map_tracking)
    pose = known.to_map(match.tf_submap_scan)
    fit = fit_of_composite(known, composite, pose)
    is_known = fit.num_counted >= MIN_COUNTED_SHARE * int(composite.scans.counts.sum())
    return Claim(pose) if is_known and needed.are_reached(best.score, fit) else None


def _places(known: KnownMap, candidates: list[_Candidate]) -> tuple[Place, ...]:
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
