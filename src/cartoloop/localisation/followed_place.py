# SPDX-License-Identifier: Apache-2.0
"""How scans of a path fit in a place if each of them is matched to the map there.

Local SLAM bends a path by some centimetres and degrees, by more where the robot turns on the spot:
scans that are moved as one then fit badly in the right place, too. Matched one after the other, as
in tracking, they fit there nearly as scans usually do, and in a wrong place hardly better.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.localisation.claim_needs import (
    FITTING_DETAIL,
    is_too_plain,
    least_score,
    needed_margin,
)
from cartoloop.localisation.fit import Fit
from cartoloop.localisation.global_search import fit_of_composite, is_same_place, refine_within
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.trail import Composite
from cartoloop.sensor.pose import Pose, compose, relative

SIGMA_M, SIGMA_RAD = 0.1, math.radians(2.0)
"""Standard deviations of the motion by local SLAM from scan to scan, as it is assumed here [m],
[rad]: with less, a scan is not drawn to the map where the path is bent."""

MIN_POINTS = 10
"""Scans with fewer returns are moved on by local SLAM alone."""

MAX_COUNTED = 1.1
"""Neither agreement nor distinctness counts more than this in the sum."""

LEAST_LOW = 0.9
"""What nine of ten of the map's scans reach counts as this share of the usual at least: where many
of them hardly fit, wrong places do, too."""

SUM_OF_SCAN, SUM_OF_PATH, FULL_M = 3.1, 2.66, 4.0
"""The sum from which a place is claimed, of a single view and of a path of the third [m]; in
between it falls linearly. On longer paths, in maps of other buildings and in wrong places, it
reached 2.57, but where offices are built alike 3.0 on the first metre, and 2.87 on the second; in
nine of ten right places it reached 2.6 to 2.8."""

SCAN_M, MAX_SCANS_M = 0.1, 1.0
"""Each scan that is kept counts as the first on the path, and all as the second at most [m]: a
robot that turns on the spot sees more, but not of other places."""

RIVAL_SUM = 0.1
"""Where scans that are moved as one prove a place, another one is its rival down to a sum that is
lower by this: a path that is bent may fit better in the wrong one of two that are built alike."""

KEPT_SUM = 2.3
"""Places are kept from one search to the next down to this sum; most wrong ones have less."""

REFUTING_SUM_OF_SCAN, REFUTING_SUM = 0.4, 0.25
"""A place is refuted by one whose sum is larger by the first, of a single view, and by the second,
of a path of `FULL_M`; in between it falls linearly."""

EXPLAINED_MARGIN, EXPLAINED_PATH_M = 0.03, 1.3
"""A place whose sum is lower by :data:`RIVAL_SUM` is also refuted if it explains a share of the
returns that is lower by the first, also if all beams might pass through glass, from a path of the
second on [m]: where the map is blurred, or ends, the right place has a low score, and what
contradicts a wrong place shows which one it is."""

NEWEST_PARTS, NEWEST_SUM = 3, 1.85
"""Of the newest part of the scans, one of the first number, agreement and distinctness must add up
to the second: where a building is built alike only in part, the newest scans contradict first."""

MAX_KEPT = 8
"""Number of places that are kept, the best."""

FITTING_SUM, FITTING_PATH_M = 3.69, 4.0
"""The sum, on a path of at least the second [m], from which a place that was claimed before is not
given up for lack of proof. The score counts twice in it: moved furniture lowers the agreement more,
another building the score, as its walls are some centimetres elsewhere. Most right places where
furniture was moved have more, and maps of other buildings had less."""

MIN_COUNTED_SHARE = 0.5
"""Share of the returns that must lie where the map is known."""

MOST_GAINED = 0.45
"""By how much the sum of the scans moved as one may be lower at most, where a place is not looked
at closely to be refuted."""


class FollowedPlace(NamedTuple):
    """A place, with the scans of a path matched there.

    Attributes
    ----------
    poses : float64, shape (k, 3), tf_map_tracking of the scans, the newest first.
    fit : of the scans there.
    total : sum of score, relative to the usual one, and of agreement and mean distinctness,
        relative to those that nine of ten of the map's scans reach, see :data:`LEAST_LOW`.
    """

    poses: FloatArray
    fit: Fit
    total: float

    @property
    def pose(self) -> Pose:
        """Pose of the newest scan, tf_map_tracking."""
        return Pose(*self.poses[0].tolist())


def needed_sum(path: float, num_scans: int) -> float:
    """Return the sum from which a place is claimed, given a path length [m] and its scans."""
    length = path + min(SCAN_M * (num_scans - 1), MAX_SCANS_M)
    return SUM_OF_SCAN + min(length / FULL_M, 1.0) * (SUM_OF_PATH - SUM_OF_SCAN)


def refuting_sum(path: float) -> float:
    """Return by how much the sum of another place must be larger, given a path length [m]."""
    share = min(path / FULL_M, 1.0)
    return REFUTING_SUM_OF_SCAN + share * (REFUTING_SUM - REFUTING_SUM_OF_SCAN)


def sum_of(known: KnownMap, fit: Fit) -> float:
    """Return how well scans fit, see :class:`FollowedPlace`; 0 where none counts."""
    if math.isnan(fit.agreement):
        return 0.0
    return fit.score / known.usual.score + _agreeing(known, fit)


def _agreeing(known: KnownMap, fit: Fit) -> float:
    """Return the sum of agreement and mean distinctness, relative to what nine of ten reach."""
    agreement = max(known.low_agreement, LEAST_LOW * known.usual.agreement)
    distinctness = max(known.low_distinctness, LEAST_LOW * known.usual.distinctness)
    return min(fit.agreement / agreement, MAX_COUNTED) + min(
        fit.mean_distinctness / distinctness, MAX_COUNTED
    )


def follow_in(
    known: KnownMap, composite: Composite, tf_map_newest: Pose, first: int | None = None
) -> FollowedPlace:
    """Match the scans of a path one after the other.

    Parameters
    ----------
    composite : the scans of the path.
    tf_map_newest : pose of the newest.
    first : scan to begin with, 0 is the newest; None: the middle one, if all of them moved as one
        fit best there.
    """
    steps = [Pose(*step) for step in composite.tf_newest_scans.tolist()]
    scans = composite.scans
    points = [scans.points[a:b] for a, b in zip(scans.firsts, scans.ends, strict=True)]
    first = len(steps) // 2 if first is None else first
    poses = [compose(tf_map_newest, step) for step in steps]
    for i in (*range(first, len(steps)), *range(first - 1, -1, -1)):
        if i != first:
            neighbour = i - 1 if i > first else i + 1
            poses[i] = compose(poses[neighbour], relative(steps[neighbour], steps[i]))
        if len(points[i]) >= MIN_POINTS:
            match = refine_within(known, points[i], poses[i], SIGMA_M, SIGMA_RAD)
            poses[i] = known.to_map(match.tf_submap_scan)
    placed = np.array(poses)
    fit = known.fit_all(scans, composite.beam_origins, placed)
    return FollowedPlace(placed, fit, sum_of(known, fit))


def follow_best(
    known: KnownMap, composite: Composite, found: Sequence[Pose], kept: Sequence[Pose] = ()
) -> list[FollowedPlace]:
    """Return those of many places where scans fit if each is matched there, the best first.

    Parameters
    ----------
    found : places where the scans fit if they are moved as one, tf_map_tracking of the newest.
    kept : where the newest scan may be by what was followed before.
    """
    followed = [follow_in(known, composite, pose, first=0) for pose in kept]
    followed += [
        follow_in(known, composite, pose)
        for pose in found
        if may_reach(known, composite, pose, KEPT_SUM)
    ]
    best: list[FollowedPlace] = []
    for place in sorted(followed, key=lambda place: -place.total):
        is_new = not any(is_same_place(place.pose, other.pose) for other in best)
        if is_new and place.total >= KEPT_SUM:
            best.append(place)
    return best[:MAX_KEPT]


def is_proved(
    known: KnownMap,
    composite: Composite,
    path: float,
    followed: Sequence[FollowedPlace],
    listed: Iterable[Pose],
    others: Iterable[Pose],
) -> bool:
    """Return whether scans that are matched one by one prove the first of the places.

    In a map without own scans it is not known how well scans fit where they were taken, so that
    nothing is proved. Nor is it where another place has a clearly higher score: beams may pass
    through what is a wall of the map, as glass that no scan of the map shows as such, so that the
    right place agrees less than a wrong one. Nor is it by scans of straight walls, unless they fit
    as the map's own do.

    Parameters
    ----------
    path : length of the path that the scans come from [m].
    followed : what :func:`follow_best` returned.
    listed : the likeliest places where the scans, moved as one, fit.
    others : further places that have to be refuted.
    """
    best = followed[0]
    num_points = int(composite.scans.counts.sum())
    if (
        not known.has_own_fits
        or len(composite.scans) < 2
        or best.total < needed_sum(path, len(composite.scans))
        or best.fit.score < least_score(known)
        or best.fit.num_counted < MIN_COUNTED_SHARE * num_points
        or is_too_plain(known, best.fit.score, best.fit)
    ):
        return False
    if not newest_agree(known, composite, best):
        return False
    least = best.total - refuting_sum(path)
    margin = needed_margin(path)

    def is_rival(other: FollowedPlace) -> bool:
        return _is_rival(best, least, margin, other) and not explains_less(best, other, path)

    def outscores(other: FollowedPlace) -> bool:
        is_other = not is_same_place(other.pose, best.pose)
        is_higher = other.fit.score > best.fit.score + 0.5 * margin
        return is_higher and is_other and not explains_less(best, other, path)

    if any(is_rival(place) for place in followed[1:]):
        return False
    if any(outscores(follow_in(known, composite, pose)) for pose in listed):
        return False
    return not any(
        may_reach(known, composite, pose, least) and is_rival(follow_in(known, composite, pose))
        for pose in others
    )


def explains_less(
    best: FollowedPlace, other: FollowedPlace, path: float, margin: float = EXPLAINED_MARGIN
) -> bool:
    """Return whether a place explains clearly less than the best, see :data:`EXPLAINED_MARGIN`.

    Parameters
    ----------
    margin : by which it must explain less if no beam passes through glass.
    """
    here, there = best.fit, other.fit
    return (
        path >= EXPLAINED_PATH_M
        and best.total - other.total >= RIVAL_SUM
        and here.explained - there.explained >= margin
        and here.explained_if_glass - there.explained_if_glass >= EXPLAINED_MARGIN
    )


def fits_along(
    known: KnownMap, composite: Composite | None, path: float, tf_map_newest: Pose
) -> bool:
    """Return whether the scans of a path, each matched, fit as well as they do in changed places.

    Parameters
    ----------
    composite : the scans; None without any.
    path : length of the path that they come from [m].
    tf_map_newest : pose of the newest scan.
    """
    if composite is None or path < FITTING_PATH_M or not known.has_own_fits:
        return False
    place = follow_in(known, composite, tf_map_newest, first=0)
    return place.total + place.fit.score / known.usual.score >= FITTING_SUM


def has_rival(
    known: KnownMap, composite: Composite, path: float, tf_map_newest: Pose, others: Iterable[Pose]
) -> bool:
    """Return whether scans fit about as well in another place if each is matched there.

    Parameters
    ----------
    path : length of the path that the scans come from [m].
    tf_map_newest : of the newest scan in the place where the scans, moved as one, fit best.
    others : the same of the other places.
    """
    if not known.has_own_fits or len(composite.scans) < 2:
        return False
    best = follow_in(known, composite, tf_map_newest)
    least = best.total - RIVAL_SUM
    is_rival = partial(_is_rival, best, least, needed_margin(path))
    return any(
        may_reach(known, composite, pose, least) and is_rival(follow_in(known, composite, pose))
        for pose in others
    )


def _is_rival(best: FollowedPlace, least: float, margin: float, other: FollowedPlace) -> bool:
    """Return whether scans fit about as well in another place, from a sum above `least` on.

    Scans that show much else than straight walls agree along corridors, too, but with a score that
    is lower by `margin`.
    """
    shows_less = (
        other.fit.detail < FITTING_DETAIL * best.fit.detail
        and best.fit.score - other.fit.score >= margin
    )
    return other.total > least and not shows_less and not is_same_place(other.pose, best.pose)


def newest_agree(known: KnownMap, composite: Composite, place: FollowedPlace) -> bool:
    """Return whether the newest scans, two at least, agree as well."""
    count = max(-(-len(composite.scans) // NEWEST_PARTS), 2)
    newest = composite.scans.take(np.arange(count))
    fit = known.fit_all(newest, composite.beam_origins[:count], place.poses[:count])
    return not math.isnan(fit.agreement) and _agreeing(known, fit) >= NEWEST_SUM


def may_reach(known: KnownMap, composite: Composite, tf_map_newest: Pose, total: float) -> bool:
    """Return whether scans that are moved as one fit so well that matched they may reach a sum."""
    fit = fit_of_composite(known, composite, tf_map_newest)
    return sum_of(known, fit) >= total - MOST_GAINED
