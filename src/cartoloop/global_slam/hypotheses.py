# SPDX-License-Identifier: Apache-2.0
"""Which matches of a wide search are believed: those that are distinct, and agree along the path.

A match in a large window may be false: corridors and wings resemble each other. A composite scan
has a hypothesis if its best match exceeds every other place where it might be. Hypotheses become
closures when several along the way agree with each other and with the path between them: a set that
is consistent in pairs (E. Olson, Recognizing places using spectrally clustered local matches, 2009;
J. Mangelson et al., Pairwise consistent measurement set maximization, ICRA 2018), found exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.config import WideSearchConfig
from cartoloop.sensor.pose import relative_all, wrap_angles


class Candidate(NamedTuple):
    """A match of a composite scan in one submap.

    Attributes
    ----------
    row : in the record of closures.
    scan : number of the composite scan.
    submap : index of the submap.
    tf_submap_scan : shape (3,), where it fits best.
    score : mean probability there.
    other_score : the best elsewhere in the window, or the threshold if none reaches it.
    """

    row: int
    scan: int
    submap: int
    tf_submap_scan: FloatArray
    score: float
    other_score: float


class Hypothesis(NamedTuple):
    """The best match of a composite scan in all submaps.

    Attributes
    ----------
    candidate : the match.
    tf_map_scan : shape (3,), where that places the composite scan.
    tf_local_scan : shape (3,), its pose before loop closure.
    travelled : path length of the robot there [m].
    evidence : by which the score exceeds the best one in another place.
    """

    candidate: Candidate
    tf_map_scan: FloatArray
    tf_local_scan: FloatArray
    travelled: float
    evidence: float


def best_place(
    candidates: Sequence[Candidate], tf_map_scan: FloatArray, config: WideSearchConfig
) -> tuple[int, float]:
    """Return the best of the matches of one composite scan, and the best score in another place.

    Matches in other submaps in the same place support the best one; what they saw elsewhere counts
    as another place too.

    Parameters
    ----------
    candidates : n matches of one composite scan.
    tf_map_scan : shape (n, 3), where they place it.
    """
    scores = np.array([candidate.score for candidate in candidates])
    best = int(np.argmax(scores))
    apart = relative_all(tf_map_scan[best], tf_map_scan)
    is_elsewhere = (np.hypot(apart[:, 0], apart[:, 1]) > config.place_distance) | (
        np.abs(wrap_angles(apart[:, 2])) > math.radians(config.place_angle_deg)
    )
    others = np.array([candidate.other_score for candidate in candidates])
    return best, float(np.max(np.where(is_elsewhere, scores, others)))


def agreement(hypotheses: Sequence[Hypothesis], config: WideSearchConfig) -> BoolArray:
    """Return which hypotheses agree with each other and with the path between them, (n, n).

    Two agree if the relative pose that they claim is the one of local SLAM, to within what it may
    drift between them.
    """
    claimed = np.array([each.tf_map_scan for each in hypotheses])
    local = np.array([each.tf_local_scan for each in hypotheses])
    travelled = np.array([each.travelled for each in hypotheses])
    agrees = np.empty((len(claimed), len(claimed)), dtype=bool)
    for i in range(len(claimed)):
        error = relative_all(claimed[i], claimed) - relative_all(local[i], local)
        between = np.abs(travelled - travelled[i])
        turn = np.abs(wrap_angles(error[:, 2]))
        agrees[i] = (
            (between <= config.max_span)
            & (
                np.hypot(error[:, 0], error[:, 1])
                <= config.max_disagreement + config.max_disagreement_growth * between
            )
            & (turn <= np.radians(config.max_turn_deg + config.max_turn_growth_deg * between))
        )
    # Relative poses of a pair differ slightly between its two sides.
    both: BoolArray = agrees & agrees.T
    return both


def heaviest_clique(agrees: BoolArray, weights: FloatArray) -> list[int]:
    """Return the set of pairwise consistent members with the largest sum of weights, ascending.

    Exact, by branch and bound: a branch ends where all that is left cannot exceed the best so far.

    Parameters
    ----------
    agrees : symmetric, shape (n, n).
    weights : positive, shape (n,).
    """
    count = len(weights)
    neighbours = [
        sum(1 << j for j in range(count) if j != i and agrees[i, j]) for i in range(count)
    ]
    order = sorted(range(count), key=lambda i: (-float(weights[i]), i))
    best_weight, best_set = -1.0, 0
    # Members so far, their weight, those that may still join.
    open_sets = [(0, 0.0, (1 << count) - 1)]
    while open_sets:
        members, weight, eligible = open_sets.pop()
        if weight > best_weight:
            best_weight, best_set = weight, members
        rest = sum(float(weights[i]) for i in range(count) if eligible >> i & 1)
        if eligible == 0 or weight + rest <= best_weight:
            continue
        first = next(i for i in order if eligible >> i & 1)
        without = eligible & ~(1 << first)
        open_sets.append((members, weight, without))
        open_sets.append(
            (members | 1 << first, weight + float(weights[first]), without & neighbours[first])
        )
    return [i for i in range(count) if best_set >> i & 1]


def consistent_set(
    hypotheses: Sequence[Hypothesis], config: WideSearchConfig
) -> list[Hypothesis] | None:
    """Return the set of hypotheses with the most evidence that can be believed, None without any.

    Parameters
    ----------
    hypotheses : in the order of the path, each with a margin above ``min_margin``.
    """
    best: list[Hypothesis] | None = None
    best_evidence = config.min_evidence
    first = 0
    for last, newest in enumerate(hypotheses):
        while hypotheses[first].travelled < newest.travelled - config.max_span:
            first += 1
        nearby = hypotheses[first : last + 1]
        agrees = agreement(nearby, config)
        with_newest = [each for each, fits in zip(nearby, agrees[-1], strict=True) if fits]
        if len(with_newest) < config.min_hypotheses:
            continue
        chosen = np.flatnonzero(agrees[-1])
        weights = np.array([each.evidence for each in with_newest])
        members = heaviest_clique(agrees[np.ix_(chosen, chosen)], weights)
        evidence = float(weights[members].sum())
        if len(members) >= config.min_hypotheses and evidence >= best_evidence:
            best, best_evidence = [with_newest[i] for i in members], evidence
    return best
