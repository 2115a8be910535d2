# SPDX-License-Identifier: Apache-2.0
"""Where in the whole map scans of a path fit, moved as one, and how well."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cartoloop.localisation.claim_needs import (
    APART_MARGIN,
    FITTING_MARGIN,
    needed_margin,
    searched_score,
)
from cartoloop.localisation.fit import Fit
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

MAX_PLACES = 12
"""Number of places that are answered, the likeliest."""

SCORE_SCALE, AGREEMENT_SCALE = 0.015, 0.04
"""Differences of score and agreement that make a place e times less probable."""

GLASS_DOUBT = 0.25
"""Share of the agreement that is due to walls seen through which does not count for the probability
of a place: where two fit alike, one of them without glass, that is the likelier."""


class Candidate(NamedTuple):
    """A place where the robot may be.

    Attributes
    ----------
    tf_map_tracking : pose of the newest scan.
    score : mean probability at the returns, thinned.
    fit : of all scans.
    """

    tf_map_tracking: Pose
    score: float
    fit: Fit

    @property
    def log_likelihood(self) -> float:
        """How probable the place is."""
        fit = self.fit
        doubt = GLASS_DOUBT * (fit.agreement - fit.solid_agreement)
        agreement = 0.0 if math.isnan(fit.agreement) else fit.agreement - doubt
        return self.score / SCORE_SCALE + agreement / AGREEMENT_SCALE


class Searched(NamedTuple):
    """Where scans fit.

    Attributes
    ----------
    candidates : the likeliest first.
    rest : other places that are listed, if there are many.
    lowest : score down to which places may be right.
    runner_up : upper limit of the score of any place but the best; NaN without any.
    are_all : whether these are all places down to `runner_up`, or it is low enough.
    """

    candidates: list[Candidate]
    rest: list[FoundPlace]
    lowest: float
    runner_up: float
    are_all: bool

    @property
    def listed(self) -> list[Pose]:
        """Poses of all places, tf_map_tracking."""
        first = [place.tf_map_tracking for place in self.candidates]
        return first + [place.tf_map_tracking for place in self.rest]


def search(known: KnownMap, composite: Composite, path: float) -> Searched:
    """Return the places where scans fit, moved as one."""
    points = composite.points
    least = searched_score(known, path)
    found = find(known, points, least)
    if found is None:
        return Searched([], [], least, math.nan, True)
    is_image = not known.has_own_fits
    margin = needed_margin(path, is_image=is_image)
    share = APART_MARGIN if is_image else FITTING_MARGIN
    lowest = found.score - max(2.0 * margin, share * known.usual.score)
    tiles = search_tiles(known, points, max(lowest, least))
    runner_up = runner_up_score(known, tiles, found)
    listed = list_places(known, points, tiles)
    # Of long lists, the rest matters only if the best place would be claimed.
    first, rest = listed.places[:MAX_PLACES], listed.places[MAX_PLACES:]
    candidates = [candidate_at(known, composite, place) for place in first]
    candidates.sort(key=lambda each: -each.log_likelihood)
    are_all = listed.is_complete or found.score - runner_up >= margin
    return Searched(candidates, rest, lowest, runner_up, are_all)


def candidate_at(known: KnownMap, composite: Composite, place: FoundPlace) -> Candidate:
    """Return a place with the fit of all scans there."""
    fit = fit_of_composite(known, composite, place.tf_map_tracking)
    return Candidate(place.tf_map_tracking, place.score, fit)


def refined(known: KnownMap, composite: Composite, tf_map_tracking: Pose) -> Candidate:
    """Return the place where scans fit best near a pose, matched as one."""
    pose = known.to_map(refine(known, composite.points, tf_map_tracking).tf_submap_scan)
    score = known.fit(composite.points, IDENTITY, pose).score
    return candidate_at(known, composite, FoundPlace(pose, score))


def unlisted_places(
    known: KnownMap, composite: Composite, path: float, searched: Searched
) -> Iterator[Candidate]:
    """Yield the places that may be right but were too low to be listed."""
    if searched.lowest < searched_score(known, path):
        yield from _lower(known, composite, searched.listed, searched.lowest)


def _lower(
    known: KnownMap,
    composite: Composite,
    listed: Sequence[Pose],
    min_score: float,
) -> Iterator[Candidate]:
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
                yield candidate_at(known, composite, FoundPlace(pose, match.score))
    divided = [match for match, is_chosen in zip(matches, is_divided, strict=True) if is_chosen]
    tiles = TileMatches(centres[is_divided], divided, min_score)
    for place in list_places(known, points, tiles).places:
        if not is_listed(place.tf_map_tracking):
            yield candidate_at(known, composite, place)
