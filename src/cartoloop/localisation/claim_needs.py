# SPDX-License-Identifier: Apache-2.0
"""What scans must reach in a place for it to be claimed, by the path that they come from.

Either of two is enough. Scans that fit as well as those that made the map prove a place by
themselves. On a path, the score may be much lower, as where the map is blurred, or local SLAM bends
the path, if agreement and distinctness make up for it and enough of what agrees is no straight
wall.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.localisation.fit import Fit
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.trail import LENGTH_M

SEARCHED_SCORE = 0.62
"""Score from which places are listed, relative to the usual one."""

SCORE_OF_SCAN, SCORE_OF_TRAIL = 0.9, 0.62
"""Score from which a place may be claimed, relative to the usual, by a single scan and by those of
`LENGTH_M` of path; in between it falls linearly. A single scan also needs the middle between what
nine of ten of the map's own scans reach and the usual: in rooms that resemble each other but for
centimetres, scans agree, and in a sharp map their score shows the centimetres."""

VIEW_M, FAR_SHARE = 6.0, 0.05
"""Distance from the robot [m] beyond which this share of the returns of a single scan must lie.
Rooms are built alike, to the centimetre, more often than buildings are: what is seen of a single
small one does not show which building it is in."""

VIEW_PATH_M = 2.0
"""Path from which scans may be of one small room [m]; up to there the distance falls linearly."""

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

MARGIN_OF_SCAN, MARGIN_OF_PATH = 0.08, 0.05
"""By which the score must exceed that of other places, for a single scan and for those of
`FULL_PATH_M` of path; in between it falls linearly."""

MARGIN_OF_IMAGE_SCAN = 0.13
"""The same of a single scan in a map without own scans: how well scans fit is not known there, so
that corners of another building may have a high score."""

FULL_PATH_M = 6.0
"""Path of a composite whose scans support each other in full [m]."""

APART_MARGIN = 0.22
"""By which the score, relative to the usual one, must exceed that of any other place for the place
to be claimed as the only one, in a map without own scans: how well scans agree in the right place
is not known there, but in wrong places and other buildings the best of all has rivals. There the
margin was 0.18 at most, in right places on recordings 0.26 at least."""

FITTING_MARGIN, FITTING_LESS = 0.17, 0.05
"""By which the score, relative to the usual one, must exceed that of other places where the scans
agree as a claim needs it, and the sum of agreement and distinctness as well: a part of the map that
was mapped less sharply has lower scores, and may be the right one."""

PLAUSIBLE_AGREEMENT, PLAUSIBLE_DISTINCTNESS = 0.95, 0.85
"""The same counts for places with these, relative to those that nine of ten scans of the map reach:
scans that disagree a little may be in the right place, though it takes more to claim it."""

FITTING_DETAIL = 0.5
"""Places with less than this share of the detail of the best one do not count as such: scans that
show much else than straight walls agree along corridors only roughly."""

DETAILED_PATH_M = 1.3
"""Path from which details make up for a lower score [m]."""

AGREEING_PATH_M = 1.3
"""Path from which places are refuted by their agreement as well [m]. Where one spot of a map comes
near another one in score, it is of a kind that other buildings have, too: a single scan shows
little else."""

DETAILED_SCORE = 0.55
"""The score that is then enough, relative to the usual one, unless :data:`SCORE_SPREADS` asks for
more."""

SCORE_SPREADS, MOST_SCORE = 3.5, 0.85
"""The score may be lower than the usual one by the first times the distance from the usual one to
what nine of ten of the map's scans reach; the second, relative to the usual one, is always enough.
Where buildings share walls to the centimetre, scans agree on many metres, and in a sharp map only
their score shows that what stands between these walls is different."""

MIN_DETAIL = 0.4
"""Share of the counted returns that must lie on walls that are not straight: corridors of one
building agree with those of another one on many metres."""

LEAST_AGREEMENT, LEAST_DISTINCTNESS = 0.97, 0.9
"""Agreement and distinctness that are needed for that at least, relative to those that nine of ten
scans of the map reach."""

SUM_OF_SCAN, SUM_OF_PATH = 1.98, 1.92
"""The sum of both that is needed, for a single scan and for those of `FULL_PATH_M` of path; in
between it falls linearly. In maps of other buildings it reached 1.90."""

MAX_COUNTED = 1.1
"""Neither of both counts more than this in the sum."""


REFUTED_SUM, REFUTING_SUM = 1.85, 0.2
"""A place with at most the first as its sum is refuted by one whose sum is larger by the second."""

MIN_REFUTING_DETAIL = 0.2
"""Share of the returns that must lie on walls that are not straight for that."""


PLAIN_DETAIL, PLAIN_IMAGE_SCORE, PLAIN_IMAGE_MARGIN = 0.3, 0.875, 0.14
"""With a smaller share of the returns than the first on walls that are not straight, scans must fit
as nine of ten of the map's own do: corridors of another building may have the same length and
width, and doors a little elsewhere. In a map without own scans, they need the second as score, or
one that exceeds that of any other place by the third."""


class Detailed(NamedTuple):
    """What a place must reach to be claimed with a low score.

    Attributes
    ----------
    score : of the scans there.
    low_agreement, low_distinctness : those that nine of ten scans of the map reach.
    total : sum of agreement and distinctness, relative to these.
    """

    score: float
    low_agreement: float
    low_distinctness: float
    total: float

    def fits(self, fit: Fit) -> bool:
        """Return whether scans agree well enough, and in enough that is no straight wall."""
        agreement, distinctness = self._relative(fit)
        return (
            fit.detail >= MIN_DETAIL
            and agreement >= LEAST_AGREEMENT
            and distinctness >= LEAST_DISTINCTNESS
            and agreement + distinctness >= self.total
        )

    def refutes(self, best: Fit, other: Fit) -> bool:
        """Return whether scans agree so much better in the best place that the other is none.

        Along straight walls, which show little else, a little that disagrees counts for much.
        """
        sum_there = sum(self._relative(other))
        return best.detail >= MIN_REFUTING_DETAIL and sum_there <= min(
            REFUTED_SUM, sum(self._relative(best)) - REFUTING_SUM
        )

    def _relative(self, fit: Fit) -> tuple[float, float]:
        """Return agreement and distinctness as they count."""
        return (
            min(fit.agreement / self.low_agreement, MAX_COUNTED),
            min(fit.distinctness / self.low_distinctness, MAX_COUNTED),
        )


class Needed(NamedTuple):
    """What a place must reach to be claimed.

    Attributes
    ----------
    score, agreement, distinctness : of the scans there.
    plausible_agreement, plausible_distinctness : from which other places may be right.
    detailed : what is enough with a lower score; None: nothing is.
    """

    score: float
    agreement: float
    distinctness: float
    plausible_agreement: float
    plausible_distinctness: float
    detailed: Detailed | None = None

    def may_be(self, fit: Fit) -> bool:
        """Return whether scans agree as they may in the right place, at any score."""
        return self.fits(fit) or (
            fit.agreement >= self.plausible_agreement
            and fit.distinctness >= self.plausible_distinctness
        )

    def fits(self, fit: Fit) -> bool:
        """Return whether scans agree as a claim needs it, at any score."""
        return self._agrees(fit) or (self.detailed is not None and self.detailed.fits(fit))

    def are_reached(self, score: float, fit: Fit) -> bool:
        """Return whether a place with this score, where scans agree like this, may be claimed."""
        if score >= self.score and self._agrees(fit):
            return True
        detailed = self.detailed
        return detailed is not None and score >= detailed.score and detailed.fits(fit)

    def _agrees(self, fit: Fit) -> bool:
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
    score = max(SCORE_OF_SCAN * known.usual.score, 0.5 * (known.low_score + known.usual.score))
    return Needed(
        _falling(score, SCORE_OF_TRAIL * known.usual.score, path),
        _falling(agreement, min(AGREEMENT_OF_TRAIL * known.low_agreement, agreement), path),
        _falling(distinctness, DISTINCTNESS_OF_TRAIL * known.low_distinctness, path),
        *_plausible_of(known),
        _detailed_of(known, path),
    )


def _plausible_of(known: KnownMap) -> tuple[float, float]:
    """Return from which agreement and distinctness another place may be right.

    In a map without own scans those of a claim are assumed, and low already.
    """
    if not known.has_own_fits:
        return math.inf, math.inf
    agreement = PLAUSIBLE_AGREEMENT * known.low_agreement
    return agreement, PLAUSIBLE_DISTINCTNESS * known.low_distinctness


def _detailed_of(known: KnownMap, path: float) -> Detailed | None:
    """Return what is enough with a low score; in a map without own scans it is not known."""
    if path < DETAILED_PATH_M or not known.has_own_fits:
        return None
    total = _falling(SUM_OF_SCAN, SUM_OF_PATH, path, FULL_PATH_M)
    score = max(DETAILED_SCORE * known.usual.score, least_score(known))
    return Detailed(score, known.low_agreement, known.low_distinctness, total)


def least_score(known: KnownMap) -> float:
    """Return the score that a claim needs, see :data:`SCORE_SPREADS`."""
    usual = known.usual.score
    return min(usual - SCORE_SPREADS * (usual - known.low_score), MOST_SCORE * usual)


def searched_score(known: KnownMap, path: float) -> float:
    """Return the score from which places are listed, given a path length [m]."""
    least = max(SEARCHED_SCORE, _claimed_score(path) - LISTED_BELOW) * known.usual.score
    if _detailed_of(known, path) is None:
        return least
    return min(least, DETAILED_SCORE * known.usual.score)


def _claimed_score(path: float) -> float:
    """Return the score from which places may be claimed, relative to the usual one."""
    return _falling(SCORE_OF_SCAN, SCORE_OF_TRAIL, path)


def shows_enough(points: FloatArray, path: float) -> bool:
    """Return whether scans show more than a small room, or the robot has driven on.

    Parameters
    ----------
    points : float64, shape (n, 2), returns, frame of the robot [m].
    path : length of the path that they come from [m].
    """
    needed = VIEW_M * max(1.0 - path / VIEW_PATH_M, 0.0)
    num_far = int(np.count_nonzero(np.hypot(points[:, 0], points[:, 1]) >= needed))
    return num_far >= FAR_SHARE * len(points)


def is_too_plain(known: KnownMap, score: float, fit: Fit, runner_up: float = math.inf) -> bool:
    """Return whether scans show little but straight walls, and fit too badly to prove a place.

    Parameters
    ----------
    score, fit : of the scans in the place, see :data:`PLAIN_DETAIL`.
    runner_up : score of the best of the others, as they were found, to a pixel.
    """
    if fit.detail >= PLAIN_DETAIL:
        return False
    if known.has_own_fits:
        return score < known.low_score
    return score < min(PLAIN_IMAGE_SCORE, runner_up + PLAIN_IMAGE_MARGIN)


class Margins(NamedTuple):
    """What refutes other places than the best one.

    Attributes
    ----------
    other, fitting : by which their score is lower at least; the second where the scans agree as a
        claim needs it.
    higher : by which their score may be higher where a lower agreement refutes them.
    agreement_counts : whether a lower agreement is enough as well.
    """

    other: float
    fitting: float
    higher: float
    agreement_counts: bool


def margins_of(known: KnownMap, path: float) -> Margins:
    """Return what refutes other places, given a path length [m]."""
    return Margins(
        needed_margin(path, is_image=not known.has_own_fits),
        FITTING_MARGIN * known.usual.score,
        0.5 * needed_margin(path),
        path >= AGREEING_PATH_M,
    )


def needed_margin(path: float, *, is_image: bool = False) -> float:
    """Return by which the score must exceed that of other places, given a path length [m].

    Parameters
    ----------
    is_image : whether the map has no own scans.
    """
    of_scan = MARGIN_OF_IMAGE_SCAN if is_image else MARGIN_OF_SCAN
    return _falling(of_scan, MARGIN_OF_PATH, path, FULL_PATH_M)


def _falling(of_scan: float, of_path: float, path: float, full: float = LENGTH_M) -> float:
    """Return what is needed of scans on a path [m]: it changes evenly up to a full length [m]."""
    return of_scan + min(path / full, 1.0) * (of_path - of_scan)
