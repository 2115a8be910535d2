# SPDX-License-Identifier: Apache-2.0
"""Places where a scan or two of one part fit in another are followed: scans nearby are searched.

Where parts overlap a little, most of a composite scan lies where the other part saw nothing, and
its score stays below what a search at all angles can afford as a threshold. If a place is right,
the scans before and behind fit nearby, at the pose that it predicts; if it is not, hardly any does.
Near that pose a low threshold costs little.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import WideSearchConfig
from cartoloop.global_slam.claims import Claim, Claims
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.hypotheses import Candidate
from cartoloop.global_slam.placing import Placement, fitted_pose
from cartoloop.sensor.pose import (
    Pose,
    compose_all,
    inverse,
    relative_all,
    wrap_angle,
)
from cartoloop.sensor.scan_points import ScanPoints

MAX_PLACES = 24
"""Places of a pair of parts that are followed, at most: those with the most evidence."""

WINDOW_M, WINDOW_RAD = 3.0, math.radians(10.0)
"""Window in which a scan is searched around its predicted pose."""

MIN_SCORE, MIN_SCORE_RATIO = 0.25, 0.45
"""Thresholds there, as ``min_score`` and ``min_score_ratio`` of `JoinConfig`."""

MIN_SEEN_SHARE, EXPECTED_SHARE = 0.35, 0.5
"""Scans are searched in submaps that have seen the first share of their returns' places, and are
expected to fit in the one that has seen the most, if that is the second share."""

MIN_AGREEING, MIN_AGREEING_SHARE = 4, 0.6
"""A place that was followed is believed if this number of scans fit there, and this share of
those that are expected to and are distinct."""

MASK_STRIDE = 4
"""Every n-th cell of a submap shows what it has seen."""


class Expected(NamedTuple):
    """Where a place would put a composite scan.

    Attributes
    ----------
    scan, submap : their numbers.
    tf_submap_scan : shape (3,).
    share : of its returns, those whose places the submap has seen.
    """

    scan: int
    submap: int
    tf_submap_scan: FloatArray
    share: float


class SeenAreas:
    """Which of the places of returns a submap has seen.

    Parameters
    ----------
    submaps : the finished submaps by their index; the owner adds to it.
    """

    def __init__(self, submaps: Sequence[FinishedSubmap]) -> None:
        self._submaps = submaps
        self._masks: dict[int, BoolArray] = {}

    def shares(self, submap: int, scans: ScanPoints, tf_submap_scan: FloatArray) -> FloatArray:
        """Return the share of the points of each scan that a submap has seen, shape (n,).

        Parameters
        ----------
        scans : n scans; those without points have seen nothing.
        tf_submap_scan : shape (n, 3).
        """
        grid = self._submaps[submap].grid
        if submap not in self._masks:
            self._masks[submap] = grid.cells[::MASK_STRIDE, ::MASK_STRIDE] > 0
        mask, step = self._masks[submap], MASK_STRIDE * grid.resolution
        counts = scans.counts
        ends = np.cumsum(counts)
        numbers = np.arange(int(counts.sum())) + np.repeat(scans.firsts - ends + counts, counts)
        x, y = scans.points[numbers].T
        at_x, at_y, theta = tf_submap_scan.T
        cos, sin = np.repeat(np.cos(theta), counts), np.repeat(np.sin(theta), counts)
        placed_x, placed_y = np.repeat(at_x, counts), np.repeat(at_y, counts)
        cols = np.rint((placed_x + cos * x - sin * y - grid.origin_x) / step).astype(np.int64)
        rows = np.rint((placed_y + sin * x + cos * y - grid.origin_y) / step).astype(np.int64)
        is_seen = (rows >= 0) & (cols >= 0) & (rows < mask.shape[0]) & (cols < mask.shape[1])
        is_seen[is_seen] = mask[rows[is_seen], cols[is_seen]]
        totals = np.concatenate(([0], np.cumsum(is_seen)))
        shares: FloatArray = (totals[ends] - totals[ends - counts]) / np.maximum(counts, 1)
        return shares


def followed_places(claims: Sequence[Claim], wide: WideSearchConfig) -> list[Pose]:
    """Return the places that claims are about, the likeliest first."""
    places: list[Pose] = []
    columns = Claims.of(claims)
    rows = np.array([each.row for each in columns.candidates], dtype=np.int64)
    columns = columns.take(np.lexsort((rows, -columns.evidence)))
    agrees, is_placed = columns.agreement(wide), np.zeros(len(columns), dtype=bool)
    for number in range(len(columns)):
        if not is_placed[number]:
            places.append(fitted_pose(columns.take(np.flatnonzero(agrees[number]))))
            if len(places) == MAX_PLACES:
                break
            is_placed |= columns.are_at(places[-1], wide)
    return places


def expected_scans(
    tf_one_other: Pose,
    scans: tuple[IntArray, FloatArray, ScanPoints],
    scan_parts: IntArray,
    submaps: tuple[IntArray, FloatArray],
    areas: SeenAreas,
) -> list[Expected]:
    """Return where a place puts composite scans of two parts, in submaps that have seen it.

    Parameters
    ----------
    scans : their numbers, their poses in their own part, shape (n, 3), and the returns of all.
    scan_parts : 0 or 1 for each of them.
    submaps : of all finished ones, 0 and 1 for those of the two parts, shape (m,), and the poses of
        each in its own part.
    """
    numbers, poses, points = scans
    parts, submap_poses = submaps
    into = (np.array(tf_one_other), np.array(inverse(Pose(*tf_one_other))))
    found = []
    for part in (0, 1):
        own = np.flatnonzero(scan_parts == part)
        there = compose_all(into[1 - part], poses[own])
        for submap in np.flatnonzero(parts == 1 - part).tolist():
            tf_submap_scan = relative_all(submap_poses[submap], there)
            shares = areas.shares(submap, points.take(numbers[own]), tf_submap_scan)
            for row in np.flatnonzero(shares > MIN_SEEN_SHARE).tolist():
                number, share = int(numbers[own[row]]), float(shares[row])
                found.append(Expected(number, submap, tf_submap_scan[row], share))
    return sorted(found, key=lambda each: each[:2])


def why_not_supported(
    found: Placement,
    expected: Sequence[Expected],
    candidates: dict[int, list[Candidate]],
    min_margin: float,
    wide: WideSearchConfig,
) -> str:
    """Return why a place that was followed cannot be believed, as a clause; "" if it can.

    Scans that fit in several places, as in a bare corridor, do not count.

    Parameters
    ----------
    expected : the scans that should fit there.
    candidates : the matches of each scan.
    min_margin : by which a match must exceed other places to be distinct.
    wide : what counts as another place.
    """
    claims = {claim.candidate.scan for claim in found.claims}
    best: dict[int, Expected] = {}
    for each in expected:
        if each.share >= max(EXPECTED_SHARE, best[each.scan].share if each.scan in best else 0.0):
            best[each.scan] = each
    agreeing, against = len(claims), 0
    for each in best.values():
        if each.scan in claims:
            continue
        here = [match for match in candidates.get(each.scan, []) if match.submap == each.submap]
        match = max(here, key=lambda match: match.score, default=None)
        if match is None:
            against += 1
        elif match.score - match.other_score >= min_margin:
            is_there = is_same_pose(match.tf_submap_scan, each.tf_submap_scan, wide)
            agreeing, against = agreeing + is_there, against + (not is_there)
    if len(claims) < MIN_AGREEING or agreeing < MIN_AGREEING_SHARE * (agreeing + against):
        return (
            f"{agreeing} scans agree on a place where {agreeing + against} should fit: at least "
            f"{MIN_AGREEING} and {MIN_AGREEING_SHARE:.0%} of them are required"
        )
    return ""


def is_same_pose(one: FloatArray, other: FloatArray, wide: WideSearchConfig) -> bool:
    """Return whether two poses are the same place."""
    x, y, theta = relative_all(one, other[np.newaxis])[0].tolist()
    return math.hypot(x, y) <= wide.place_distance and abs(wrap_angle(theta)) <= math.radians(
        wide.place_angle_deg
    )
