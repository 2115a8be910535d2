# SPDX-License-Identifier: Apache-2.0
"""What scans must show in an image for a place to be claimed: its usual fit is not known.

Either of two is enough on a path: that no other place comes near in score, or that none explains
nearly as many of the returns. What stands at straight walls has to agree as well: in images of
other buildings, straight walls agree on metres.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from cartoloop.localisation.claim_needs import APART_MARGIN
from cartoloop.localisation.fit import Fit
from cartoloop.localisation.followed_place import (
    FULL_M,
    RIVAL_SUM,
    FollowedPlace,
    explains_less,
    follow_in,
    may_reach,
    newest_agree,
)
from cartoloop.localisation.global_search import is_same_place
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.trail import Composite
from cartoloop.sensor.pose import Pose

APART_PATH_M = 1.5
"""Path from which a place is also claimed where its score exceeds that of any other clearly, see
:data:`APART_MARGIN` [m]."""

APART_SCORE, APART_AGREEMENT, APART_DISTINCTNESS = 0.84, 0.75, 0.55
"""Score, agreement and distinctness that it needs for that, relative to the usual ones."""

MIN_APART_DETAIL = 0.3
"""Share of the returns that must lie on walls that are not straight for that."""

APART_SUM = 0.95
"""What the margin of its score, relative to the usual score, and its detailed agreement must add up
to: in another building, straight walls may agree on metres and no other place come near, but of the
rest less agrees. There the sum reached 0.92; in right places that nothing else had shown, it was
0.98 at least."""

IMAGE_PATH_M, IMAGE_EXPLAINED, IMAGE_DETAIL = 1.5, 0.8, 0.4
"""In a map without own scans it is not known how well scans fit where they were taken. There, from
a path of the first on [m], the place must explain the second share of the returns, and the third
share must lie on walls that are not straight."""

IMAGE_SUM = 1.65
"""What the place explains and the detailed agreement must add up to this: in other buildings,
straight walls agree on metres, and less of what stands at them. There the sum reached 1.62."""

IMAGE_COUNTED_SHARE = 0.8
"""Share of the returns that must lie where an image is known: at its edge, where a corridor ends in
the unknown, scans of another building agreed on 4 m, with 79% of the returns where it is known."""

IMAGE_MARGIN_OF_SCAN, IMAGE_MARGIN = 0.1, 0.05
"""Every other place must explain a share that is lower by the first, of a single view, and by the
second, of a path of `FULL_M`; in between it falls linearly."""


def is_apart(known: KnownMap, path: float, score: float, runner_up: float, fit: Fit) -> bool:
    """Return whether a place is claimed as the only one, see :data:`APART_MARGIN`.

    Parameters
    ----------
    path : length of the path that the scans come from [m].
    score, fit : of the scans there.
    runner_up : upper limit of the score of any other place.
    """
    usual = known.usual
    margin = (score - runner_up) / usual.score
    return (
        not known.has_own_fits
        and path >= APART_PATH_M
        and margin >= APART_MARGIN
        and score >= APART_SCORE * usual.score
        and fit.agreement >= APART_AGREEMENT * usual.agreement
        and fit.distinctness >= APART_DISTINCTNESS * usual.distinctness
        and fit.detail >= MIN_APART_DETAIL
        and margin + fit.detailed_agreement >= APART_SUM
    )


def is_proved_in_image(
    known: KnownMap,
    composite: Composite,
    path: float,
    followed: Sequence[FollowedPlace],
    others: Iterable[Pose],
) -> bool:
    """Return whether scans that are matched one by one prove the first place in an image.

    Parameters
    ----------
    path, followed : as for :func:`is_proved`.
    others : all further places that have to be refuted.
    """
    best = followed[0]
    if (
        known.has_own_fits
        or path < IMAGE_PATH_M
        or len(composite.scans) < 2
        or best.fit.explained < IMAGE_EXPLAINED
        or best.fit.explained + best.fit.detailed_agreement < IMAGE_SUM
        or best.fit.detail < IMAGE_DETAIL
        or best.fit.num_counted < IMAGE_COUNTED_SHARE * int(composite.scans.counts.sum())
        or not newest_agree(known, composite, best)
    ):
        return False
    share = min(path / FULL_M, 1.0)
    margin = IMAGE_MARGIN_OF_SCAN + share * (IMAGE_MARGIN - IMAGE_MARGIN_OF_SCAN)

    def is_refuted(other: FollowedPlace) -> bool:
        is_same = is_same_place(other.pose, best.pose)
        return is_same or explains_less(best, other, path, margin)

    if not all(map(is_refuted, followed[1:])):
        return False
    least = best.total - RIVAL_SUM
    return all(
        not may_reach(known, composite, pose, least)
        or is_refuted(follow_in(known, composite, pose))
        for pose in others
    )
