# SPDX-License-Identifier: Apache-2.0
"""Where in the whole map scans fit: exact branch and bound, and every other place that fits."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import LeastSquaresMatcherConfig
from cartoloop.localisation.fit import Fit
from cartoloop.localisation.known_map import TILE_M, KnownMap
from cartoloop.localisation.trail import Composite
from cartoloop.scan_matching import least_squares
from cartoloop.scan_matching.branch_and_bound import (
    NO_RUNNER_UP,
    BranchAndBoundMatch,
    RunnerUp,
)
from cartoloop.scan_matching.least_squares import LeastSquaresMatch, MatchOptions
from cartoloop.sensor.pose import Pose, compose_all, relative, wrap_angle
from cartoloop.sensor.scan_points import ScanPoints

PLACE_DISTANCE_M, PLACE_ANGLE_RAD = 1.0, math.radians(15.0)
"""Poses farther apart than the first, or turned by more than the second, are different places."""

HIGH_SCORES = (0.9, 0.75)
"""Scores relative to the usual one that are searched for first: that takes less time by far."""

NUM_PARTS = 2
"""Number of parts of the rotations, and of the windows of a list, that threads search. Results do
not depend on it."""

MAX_PARTS = 2000
"""Number of parts that tiles are divided into, at most: where scans fit everywhere, they prove
nothing."""

MAX_PLACES = 40
"""Number of places that are listed, the best."""

REFINEMENT_SIGMA_CELLS, REFINEMENT_LEVER_M = 2.0, 5.0
"""Standard deviation of the prior of the refinement [cells]; divided by the range for angles."""

USUAL_RESIDUAL = 0.4
"""Root mean square of 1 - M at the returns of scans that fit."""

_HEADINGS = [(2 * part + 1) * math.pi / NUM_PARTS for part in range(NUM_PARTS)]
"""The middles of the parts of the rotations."""

_threads = ThreadPoolExecutor(NUM_PARTS, thread_name_prefix="places")

_MATCHER = LeastSquaresMatcherConfig()

FAR_M = 1e6
"""Places farther from the corner of a map's grid are not searched [m]."""


class FoundPlace(NamedTuple):
    """A place where scans fit.

    Attributes
    ----------
    tf_map_tracking : pose of the newest of the scans.
    score : mean probability at the returns there.
    """

    tf_map_tracking: Pose
    score: float


def is_same_place(tf_map_a: Pose, tf_map_b: Pose) -> bool:
    """Return whether two poses are in the same place."""
    apart = relative(tf_map_a, tf_map_b)
    return (
        math.hypot(apart.x, apart.y) <= PLACE_DISTANCE_M
        and abs(wrap_angle(apart.theta)) <= PLACE_ANGLE_RAD
    )


def find(known: KnownMap, points: FloatArray, min_score: float) -> FoundPlace | None:
    """Return the best place in the whole map at any angle, None where none reaches a score.

    Threads search parts of the rotations, first for high scores: as soon as any part has a place,
    the best of all parts is the best of the map.

    Parameters
    ----------
    points : float64, shape (n, 2), frame of the robot [m].
    min_score : that places must reach.
    """
    usual = known.usual.score
    rungs = [share * usual for share in HIGH_SCORES if share * usual > min_score]
    for least in (*rungs, min_score):
        search = partial(
            known.matcher.match_full_submap,
            points,
            min_score=least,
            angular_window=math.pi / NUM_PARTS,
        )
        parts = [_threads.submit(search, heading=heading) for heading in _HEADINGS]
        found = [match for part in parts if (match := part.result()) is not None]
        if found:
            best = max(found, key=lambda match: match.score)
            return FoundPlace(known.to_map(best.tf_submap_scan), best.score)
    return None


def find_near(
    known: KnownMap,
    points: FloatArray,
    tf_map_tracking: Pose,
    linear_window: float,
    angular_window: float,
    min_score: float,
) -> FoundPlace | None:
    """Return the best place around a pose, None where none reaches a score.

    Parameters
    ----------
    points : float64, shape (n, 2), frame of the robot [m].
    linear_window, angular_window : to each side of the pose [m], [rad].
    """
    # Odometry that has gone astray may lead anywhere, also to where there are no cells.
    centre, grid = known.to_grid(tf_map_tracking), known.grid
    if not max(abs(centre.x - grid.origin_x), abs(centre.y - grid.origin_y)) <= FAR_M:
        return None
    found = known.matcher.match(
        points,
        centre,
        linear_window=linear_window,
        angular_window=angular_window,
        min_score=min_score,
        runner_up=NO_RUNNER_UP,
    )
    return None if found is None else FoundPlace(known.to_map(found.tf_submap_scan), found.score)


class TileMatches(NamedTuple):
    """The best place in each part of the map, and whether that part has others.

    Attributes
    ----------
    centres : float64, shape (n, 3), middles of the parts, grid frame.
    matches : of each part; None where no place reaches the score.
    min_score : that places must reach.
    """

    centres: FloatArray
    matches: list[BranchAndBoundMatch | None]
    min_score: float


def search_tiles(known: KnownMap, points: FloatArray, min_score: float) -> TileMatches:
    """Return the best place in each tile of the map; threads share the tiles.

    Parameters
    ----------
    points : float64, shape (n, 2), frame of the robot [m].
    min_score : that places must reach.
    """
    centres = known.tile_centres
    matches = _match_in(known, points, centres, 0.5 * TILE_M, math.pi, min_score)
    return TileMatches(centres, matches, min_score)


def runner_up_score(known: KnownMap, tiles: TileMatches, best: FoundPlace) -> float:
    """Return the score of the best place elsewhere, or an upper limit of it.

    Where no other place was found it is the least score that was searched for.

    Parameters
    ----------
    tiles : where the same scan fits.
    best : the best place of all.
    """
    runner_up = tiles.min_score
    for match in tiles.matches:
        if match is not None:
            is_best = is_same_place(known.to_map(match.tf_submap_scan), best.tf_map_tracking)
            runner_up = max(runner_up, match.runner_up if is_best else match.score)
    return runner_up


class Listing(NamedTuple):
    """The places where scans fit.

    Attributes
    ----------
    places : the best first.
    is_complete : whether these are all places that reach the score.
    """

    places: list[FoundPlace]
    is_complete: bool


def list_places(known: KnownMap, points: FloatArray, tiles: TileMatches) -> Listing:
    """Return all places of the map where scans fit.

    Each part of the map has its best place; a part with another place is divided, and searched
    again.

    Parameters
    ----------
    points : float64, shape (n, 2), frame of the robot [m].
    tiles : what :func:`search_tiles` returned for them.
    """
    centres, matches, min_score = tiles
    linear, angular = 0.5 * TILE_M, math.pi
    found: list[BranchAndBoundMatch] = []
    num_searched = 0
    while True:
        found += [match for match in matches if match is not None]
        is_divided = np.array(
            [match is not None and match.runner_up > 0.0 for match in matches], dtype=np.bool_
        )
        linear, angular = 0.5 * linear, 0.5 * angular
        centres = _divided(centres[is_divided], linear, angular)
        num_searched += len(centres)
        if len(centres) == 0 or num_searched > MAX_PARTS:
            break
        matches = _match_in(known, points, centres, linear, angular, min_score)
    places: list[FoundPlace] = []
    for match in sorted(found, key=lambda match: -match.score):
        pose = known.to_map(match.tf_submap_scan)
        if not any(is_same_place(pose, place.tf_map_tracking) for place in places):
            places.append(FoundPlace(pose, match.score))
    is_complete = len(centres) == 0 and len(places) <= MAX_PLACES
    return Listing(places[:MAX_PLACES], is_complete)


def _match_in(
    known: KnownMap,
    points: FloatArray,
    centres: FloatArray,
    linear: float,
    angular: float,
    min_score: float,
) -> list[BranchAndBoundMatch | None]:
    """Return the best match in each of many windows, with its runner-up; threads share them."""

    def search(part: FloatArray) -> list[BranchAndBoundMatch | None]:
        count = len(part)
        return known.matcher.match_all(
            ScanPoints.of([points]).take(np.zeros(count, dtype=np.int64)),
            np.ascontiguousarray(part),
            linear_windows=np.full(count, linear),
            angular_windows=np.full(count, angular),
            min_score=min_score,
            groups=np.arange(count),
            max_of_group=1,
            runner_up=RunnerUp(PLACE_DISTANCE_M, PLACE_ANGLE_RAD, 1.0),
        ).matches

    matches: list[BranchAndBoundMatch | None] = [None] * len(centres)
    parts = [slice(first, None, NUM_PARTS) for first in range(NUM_PARTS)]
    for part, found in zip(parts, _threads.map(search, [centres[p] for p in parts]), strict=True):
        matches[part] = found
    return matches


def _divided(centres: FloatArray, linear: float, angular: float) -> FloatArray:
    """Return the centres of the eight parts of windows, shape (8 n, 3), given their half sizes."""
    offsets = np.array(
        [
            (x * linear, y * linear, theta * angular)
            for theta in (-1, 1)
            for y in (-1, 1)
            for x in (-1, 1)
        ]
    )
    return np.ascontiguousarray((centres[:, None] + offsets[None]).reshape(-1, 3))


def refine(known: KnownMap, points: FloatArray, tf_map_tracking: Pose) -> LeastSquaresMatch:
    """Return the match by least squares near a pose; its pose and axes are those of the grid."""
    sigma = REFINEMENT_SIGMA_CELLS * known.grid.resolution
    return refine_within(known, points, tf_map_tracking, sigma, sigma / REFINEMENT_LEVER_M)


def refine_within(
    known: KnownMap, points: FloatArray, tf_map_tracking: Pose, sigma: float, angle_sigma: float
) -> LeastSquaresMatch:
    """Return the same, given the standard deviations of the pose [m], [rad]."""
    translation, rotation = sigma**-2, angle_sigma**-2
    prior = known.to_grid(tf_map_tracking)
    return least_squares.match(
        known.smooth_map,
        points,
        prior,
        prior,
        np.array((translation, 0.0, 0.0, translation, 0.0, rotation)),
        MatchOptions(
            _MATCHER.occupied_space_weight / USUAL_RESIDUAL**2,
            _MATCHER.max_num_iterations,
            _MATCHER.tolerance,
        ),
    )


def fit_of_composite(known: KnownMap, composite: Composite, tf_map_newest: Pose) -> Fit:
    """Return how well the scans of a composite fit, given the pose of the newest."""
    poses = compose_all(np.array(tf_map_newest), composite.tf_newest_scans)
    return known.fit_all(composite.scans, composite.beam_origins, poses)
