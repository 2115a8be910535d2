# SPDX-License-Identifier: Apache-2.0
"""Places of two parts that were examined before, and which of two that fit is the right one."""

from __future__ import annotations

from collections.abc import Sequence

from cartoloop.config import JoinConfig, WideSearchConfig
from cartoloop.global_slam.claims import Claim, Claims
from cartoloop.global_slam.join_evidence import Examined, JoinAttempt
from cartoloop.global_slam.placing import Placement, evidence_of, placement
from cartoloop.sensor.pose import Pose

RETRY_EVIDENCE = 1.5
"""A place is examined again when its evidence has grown to this multiple."""

STANDS_OUT, MIN_RETURNS = 1.5, 1000
"""Of two places that the geometry allows, one is right if at the other one this many times as large
a share of the returns lies on floor, where as many returns can be compared in both. Of 23 pairs of
sessions of aces and mit-csail, each placed rightly and wrongly, it was 1.6 times or more in all."""


def closed_places(
    attempt: JoinAttempt, claims: Sequence[Claim], wide: WideSearchConfig
) -> list[Pose]:
    """Return the places that were refused, less those that more scans agree on by now.

    A part that is bent fits better where more scans hold it. What was examined more strictly than
    the attempt is now says nothing.
    """
    return [
        each.tf_one_other
        for each in attempt.refused
        if each.strictness <= attempt.strictness
        and evidence_of(claims, each.tf_one_other, wide) < RETRY_EVIDENCE * each.evidence
    ]


def reopen(
    attempt: JoinAttempt, tf_one_other: Pose, claims: Sequence[Claim], wide: WideSearchConfig
) -> None:
    """Forget that a place was refused, since more is searched there.

    Parameters
    ----------
    tf_one_other : the place.
    claims : about the two parts; that a claim is about both says that two poses are one place.
    """
    columns = Claims.of(claims)
    is_near = columns.are_at(tf_one_other, wide)
    attempt.refused[:] = [
        each
        for each in attempt.refused
        if not (is_near & columns.are_at(each.tf_one_other, wide)).any()
    ]


def examined_already(attempt: JoinAttempt, wide: WideSearchConfig) -> Examined | None:
    """Return what was found where the best placement is, None if it should be examined (again)."""
    found = attempt.found
    assert found is not None
    for each in attempt.undecided:
        is_there = evidence_of(found.claims, each.tf_one_other, wide) > 0.0
        if is_there and found.evidence < RETRY_EVIDENCE * each.evidence:
            return each
    return None


def rival_to_examine(
    attempt: JoinAttempt,
    claims: Sequence[Claim],
    closed: Sequence[Pose],
    join: JoinConfig,
    wide: WideSearchConfig,
) -> Placement | None:
    """Return the next place that fits too, None if all of them were examined.

    Parameters
    ----------
    attempt : its best placement is allowed by the geometry.
    claims : about the two parts.
    closed : places that were refused.
    """
    assert attempt.found is not None
    known = [*closed, *(each.tf_one_other for each in attempt.undecided)]
    rival = placement(claims, known, join, wide)
    if rival is None or rival.evidence <= join.max_rival_share * attempt.found.evidence:
        return None
    return rival


def refused_place_weighs(
    attempt: JoinAttempt, claims: Sequence[Claim], join: JoinConfig, wide: WideSearchConfig
) -> bool:
    """Return whether the best placement has hardly more evidence than one that was refused.

    Where one place looks right and is not, the next one may be no better. A place where the scans
    themselves do not agree with the other part does not look right: as in any corridor, matches
    that are not distinct came together by chance.
    """
    assert attempt.found is not None
    limit = attempt.found.evidence / STANDS_OUT
    return any(
        each.check.scans_agree(join) and evidence_of(claims, each.tf_one_other, wide) > limit
        for each in attempt.refused
    )


def stands_out(examined: Examined, attempt: JoinAttempt, wide: WideSearchConfig) -> bool:
    """Return whether the best placement fits far better than all others that were examined.

    Parameters
    ----------
    examined : what was found there.
    """
    assert attempt.found is not None
    claims = attempt.found.claims
    others = [
        each.check
        for each in attempt.undecided
        if evidence_of(claims, each.tf_one_other, wide) == 0.0
    ]
    counted = [each.on_wall + each.on_floor for each in (examined.check, *others)]
    return min(counted) >= MIN_RETURNS and all(
        each.floor_share >= STANDS_OUT * examined.check.floor_share for each in others
    )


def reason(why_not: str, attempt: JoinAttempt) -> str:
    """Return why parts are not joined: because of what the geometry contradicted, if anything."""
    if attempt.refused and attempt.check is not None and attempt.check.fault:
        return attempt.check.fault
    return why_not
