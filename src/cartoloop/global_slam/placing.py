# SPDX-License-Identifier: Apache-2.0
"""Where one part of a map lies in another: sets of hypotheses that agree on one transform.

Nothing is known of it before. A hypothesis is a composite scan of one part that fits in one place
of the other, and in no other place of it. A placement is a set of hypotheses, of scans of either
part, that agree in pairs: the relative pose of two of them is the same in both parts. It can be
believed if it is large, extends over some metres, and exceeds every other placement by far.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import JoinConfig, WideSearchConfig
from cartoloop.global_slam.claims import Claim, Claims
from cartoloop.global_slam.hypotheses import heaviest_clique
from cartoloop.sensor.pose import Pose, compose


class Placement(NamedTuple):
    """A set of claims that agree.

    Attributes
    ----------
    claims : at least one.
    tf_one_other : where they place the other part.
    evidence : of all of them.
    extent : largest distance between two of them [m].
    rival : evidence of the best set that places it elsewhere, also where that was refused.
    """

    claims: tuple[Claim, ...]
    tf_one_other: Pose
    evidence: float
    extent: float
    rival: float


def placement(
    claims: Sequence[Claim],
    refused: Sequence[Pose],
    join: JoinConfig,
    wide: WideSearchConfig,
    refused_weight: float = 1.0,
) -> Placement | None:
    """Return the placement with the most evidence among those not refused; None without claims.

    Parameters
    ----------
    claims : about two parts.
    refused : placements that the geometry contradicts.
    refused_weight : share of the evidence of these that counts against others: all of it, unless
        the geometry will be examined strictly.
    """
    if not claims:
        return None
    claims = Claims.of(claims)
    agrees, evidence = claims.agreement(wide), claims.evidence
    is_left = np.ones(len(claims), dtype=bool)
    for pose in refused:
        is_left &= ~claims.are_at(pose, wide)
    best = _heaviest(agrees, evidence, np.flatnonzero(is_left))
    if not best:
        return None
    chosen = [claims[i] for i in best]
    strongest = max(chosen, key=lambda claim: (claim.evidence, -claim.candidate.row))
    pose = strongest.tf_one_other
    is_elsewhere = ~claims.are_at(pose, wide)
    rival = _most(agrees, evidence, np.flatnonzero(is_left & is_elsewhere))
    if not is_left.all():
        # Where a place that fits was refused, places look alike: what it had counts against others.
        of_all = _most(agrees, evidence, np.flatnonzero(is_elsewhere))
        rival = max(refused_weight * of_all, rival)
    places = np.array([claim.tf_one_scan[:2] for claim in chosen])
    extent = np.hypot(*np.moveaxis(places[:, np.newaxis] - places, 2, 0)).max()
    return Placement(
        tuple(chosen),
        pose,
        sum(claim.evidence for claim in chosen),
        float(extent),
        rival,
    )


def _most(agrees: BoolArray, evidence: FloatArray, rows: IntArray) -> float:
    """Return the evidence of the best set of some claims."""
    return float(sum(evidence[_heaviest(agrees, evidence, rows)].tolist()))


def why_not_believed(found: Placement | None, join: JoinConfig, wide: WideSearchConfig) -> str:
    """Return why a placement cannot be believed, as a clause; "" if it can."""
    if found is None:
        return "no scan of the one fits in one place of the other alone"
    count = len(found.claims)
    if count < join.min_hypotheses or found.evidence < join.min_evidence:
        return (
            f"at most {count} scans agree on a place, with an evidence of {found.evidence:.2f}: at "
            f"least {join.min_hypotheses} and {join.min_evidence:g} are required"
        )
    if found.extent < join.min_extent:
        return (
            f"the {count} scans that agree lie within {found.extent:.1f} m: they could fit "
            "elsewhere too"
        )
    if is_ambiguous(found, join):
        return (
            f"two places fit: the scans that agree have an evidence of {found.evidence:.2f}, those "
            f"that agree on another place {found.rival:.2f}"
        )
    return ""


def is_ambiguous(found: Placement, join: JoinConfig) -> bool:
    """Return whether another place fits, too."""
    return found.rival > join.max_rival_share * found.evidence


def _heaviest(agrees: BoolArray, evidence: FloatArray, rows: IntArray) -> list[int]:
    """Return the set of claims that agree with the most evidence, ascending; empty without any.

    Parameters
    ----------
    agrees, evidence : of all claims.
    rows : ascending, those to choose from.
    """
    agrees, weights = agrees[np.ix_(rows, rows)], evidence[rows]
    support = agrees @ weights
    best: list[int] = []
    best_weight = -1.0
    searched: set[bytes] = set()
    for seed in np.argsort(-support, kind="stable").tolist():
        if support[seed] <= best_weight:
            break  # no set with this claim can be heavier
        near = np.flatnonzero(agrees[seed])
        near = near[np.argsort(-weights[near], kind="stable")][:MAX_SET]
        # Many claims have the same strongest ones around them.
        if float(weights[near].sum()) < best_weight or (key := near.tobytes()) in searched:
            continue
        searched.add(key)
        members = heaviest_clique(agrees[np.ix_(near, near)], weights[near])
        weight = float(weights[near[members]].sum())
        if weight > best_weight:
            best, best_weight = sorted(near[members].tolist()), weight
    return [int(row) for row in rows[best]]


def fitted_pose(claims: Sequence[Claim]) -> Pose:
    """Return where claims that agree place the other part in the one: the pose that fits them best.

    A single match is a few tenths of a metre and a degree off: at the far end of a part that is a
    metre. Together, as far apart as they lie, they show the heading.
    """
    columns = Claims.of(claims)
    one, other = columns.tf_one_scan, columns.tf_other_scan
    weights = np.maximum(columns.evidence, MIN_WEIGHT)
    centres = [np.average(poses[:, :2], axis=0, weights=weights) for poses in (one, other)]
    a, b = other[:, :2] - centres[1], one[:, :2] - centres[0]
    turns = one[:, 2] - other[:, 2]
    sin = weights @ (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] + LEVER_M**2 * np.sin(turns))
    cos = weights @ (a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + LEVER_M**2 * np.cos(turns))
    turned = Pose(0.0, 0.0, math.atan2(sin, cos))
    x, y, theta = compose(turned, Pose(-float(centres[1][0]), -float(centres[1][1]), 0.0))
    return Pose(x + float(centres[0][0]), y + float(centres[0][1]), theta)


def evidence_of(claims: Sequence[Claim], tf_one_other: Pose, wide: WideSearchConfig) -> float:
    """Return the evidence of the largest set of claims that agree on about a place."""
    columns = Claims.of(claims)
    near = columns.take(np.flatnonzero(columns.are_at(tf_one_other, wide)))
    if not near:
        return 0.0
    return _most(near.agreement(wide), near.evidence, np.arange(len(near)))


MAX_SET = 24
"""Claims in a set, at most: those with the most evidence. The search is exact, and
its time may double with each."""

LEVER_M, MIN_WEIGHT = 5.0, 0.01
"""Headings of matches count as positions at this distance [m], and a match at least this much."""
