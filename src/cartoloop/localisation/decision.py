# SPDX-License-Identifier: Apache-2.0
"""What a search of the whole map amounts to: a place that is claimed, several, or none.

A place is claimed if it fits as scans usually fit, and every other place is refuted: by a clearly
lower score, or because beams would pass through walls there, or end on its floor.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.localisation.answer import Place
from cartoloop.localisation.fit import Fit
from cartoloop.localisation.global_search import (
    FoundPlace,
    find,
    fit_of_composite,
    list_places,
    refine,
    runner_up_score,
    search_tiles,
)
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.trail import LENGTH_M, Composite
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import Pose

SEARCHED_SCORE, POSSIBLE_AGREEMENT = 0.62, 0.6
"""Score and agreement from which places are listed, relative to the usual."""

SCORE_OF_SCAN, SCORE_OF_TRAIL = 0.9, 0.62
"""Score from which a place may be claimed, relative to the usual, by a single scan and by those of
`LENGTH_M` of path; in between it falls linearly. Single scans of one office fit somewhere in
another one nearly as well as in their own, but those of a path do not."""

LISTED_BELOW = 0.15
"""Places are listed from a score that is lower by this than that of a claim."""

AGREEMENT_OF_SCAN, AGREEMENT_OF_TRAIL = 0.98, 0.98
"""The same for the agreement: of a single scan relative to the usual one, of `LENGTH_M` of path
relative to that which nine of ten scans of the map reach."""

DISTINCTNESS_OF_SCAN, DISTINCTNESS_OF_TRAIL = 1.0, 0.9
"""The same for the distinctness, both relative to that which nine of ten scans of the map reach: in
a wrong place, corridors agree, and what stands at them does not."""

REFUTED_PATH_M = 2.0
"""Path that a claim needs for each claim before that the scans then refuted [m]."""

MAX_REFUTED_PATH_M = 9.0
"""It needs no more than this [m]."""

MIN_COUNTED_SHARE = 0.5
"""Share of the returns that must lie where the map is known."""

MARGIN_OF_SCAN, MARGIN_OF_PATH = 0.08, 0.05
"""By which the score must exceed that of other places, for a single scan and for those of
`FULL_PATH_M` of path; in between it falls linearly."""

FULL_PATH_M = 6.0
"""Path of a composite whose scans support each other in full [m]."""

FITTING_MARGIN = 0.15
"""By which the score must exceed that of other places where the scans agree as a claim needs it: a
part of the map that was mapped less sharply has lower scores, and may be the right one."""

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
    match : of the refinement.
    """

    tf_map_tracking: Pose
    match: LeastSquaresMatch


class Decision(NamedTuple):
    """What a search amounts to.

    Attributes
    ----------
    claim : the place, or None.
    places : where the robot may be if no place is claimed, the likeliest first.
    runner_up : upper limit of the score of any place but the best; NaN if nothing fits.
    """

    claim: Claim | None
    places: tuple[Place, ...]
    runner_up: float


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


class Needed(NamedTuple):
    """What a place must reach to be claimed.

    Attributes
    ----------
    score, agreement, distinctness : of the scans there.
    """

    score: float
    agreement: float
    distinctness: float

    def fits(self, fit: Fit) -> bool:
        """Return whether scans agree as a claim needs it."""
        return fit.agreement >= self.agreement and fit.distinctness >= self.distinctness


def needed_of(known: KnownMap, path: float, num_refuted: int = 0) -> Needed | None:
    """Return what a claim needs; None if the path is too short for any.

    Parameters
    ----------
    path : length of the path that the scans come from [m].
    num_refuted : claims that the scans refuted soon after: the map may be of another building.
    """
    if path < min(num_refuted * REFUTED_PATH_M, MAX_REFUTED_PATH_M):
        return None
    agreement = AGREEMENT_OF_SCAN * known.usual.agreement
    distinctness = DISTINCTNESS_OF_SCAN * known.low_distinctness
    return Needed(
        _claimed_score(path) * known.usual.score,
        _falling(agreement, min(AGREEMENT_OF_TRAIL * known.low_agreement, agreement), path),
        _falling(distinctness, DISTINCTNESS_OF_TRAIL * known.low_distinctness, path),
    )


def _falling(of_scan: float, of_trail: float, path: float) -> float:
    """Return what is needed of scans on a path [m]: it changes evenly up to `LENGTH_M`."""
    return of_scan + min(path / LENGTH_M, 1.0) * (of_trail - of_scan)


def decide(known: KnownMap, composite: Composite, path: float, num_refuted: int = 0) -> Decision:
    """Search scans in the whole map.

    Parameters
    ----------
    path : length of the path that the scans come from [m].
    num_refuted : claims that the scans refuted soon after, see :func:`needed_of`.
    """
    points = composite.points
    if len(points) < MIN_POINTS:
        return NOTHING
    needed, least = needed_of(known, path, num_refuted), searched_score(known, path)
    found = find(known, points, least)
    if found is None:
        return NOTHING
    margin = needed_margin(path)
    tiles = search_tiles(known, points, max(found.score - max(2.0 * margin, FITTING_MARGIN), least))
    runner_up = runner_up_score(known, tiles, found)
    listed = list_places(known, points, tiles)
    candidates = [_candidate(known, composite, place) for place in listed.places]
    candidates.sort(key=lambda each: -each.log_likelihood)
    if not candidates:
        return NOTHING
    best, others = candidates[0], candidates[1:]
    are_all = listed.is_complete or found.score - runner_up >= margin
    if needed is not None and are_all:
        claim = _claim(known, composite, best, needed)
        if claim is not None and all(_refutes(best, each, margin, needed) for each in others):
            return Decision(claim, (), runner_up)
    return Decision(None, _places(known, candidates), runner_up)


def searched_score(known: KnownMap, path: float) -> float:
    """Return the score from which places are listed, given a path length [m]."""
    return max(SEARCHED_SCORE, _claimed_score(path) - LISTED_BELOW) * known.usual.score


def _claimed_score(path: float) -> float:
    """Return the score from which places may be claimed, relative to the usual one."""
    return _falling(SCORE_OF_SCAN, SCORE_OF_TRAIL, path)


def needed_margin(path: float) -> float:
    """Return by which the score must exceed that of other places, given a path length [m]."""
    share = min(path / FULL_PATH_M, 1.0)
    return MARGIN_OF_SCAN + share * (MARGIN_OF_PATH - MARGIN_OF_SCAN)


def _candidate(known: KnownMap, composite: Composite, place: FoundPlace) -> _Candidate:
    fit = fit_of_composite(known, composite, place.tf_map_tracking)
    return _Candidate(place.tf_map_tracking, place.score, fit)


def _refutes(best: _Candidate, other: _Candidate, margin: float, needed: Needed) -> bool:
    """Return whether the best place fits so much better that the other is none.

    Parameters
    ----------
    margin : by which the other's score is lower at least.
    needed : for a claim; where the other place agrees like that, it takes more to refute it.
    """
    behind = best.fit.agreement - other.fit.agreement
    lower = best.score - other.score
    if needed.fits(other.fit):
        return lower >= FITTING_MARGIN
    return lower >= margin or (behind >= REFUTING_AGREEMENT and lower > -0.5 * margin)


def _claim(known: KnownMap, composite: Composite, best: _Candidate, needed: Needed) -> Claim | None:
    """Return the best place as a claim if the scans fit there as they usually do."""
    if best.score < needed.score or known.value_at(best.tf_map_tracking) == 0:
        return None
    match = refine(known, composite.points, best.tf_map_tracking)
    pose = known.to_map(match.tf_submap_scan)
    fit = fit_of_composite(known, composite, pose)
    is_known = fit.num_counted >= MIN_COUNTED_SHARE * int(composite.scans.counts.sum())
    return Claim(pose, match) if needed.fits(fit) and is_known else None


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
