# SPDX-License-Identifier: Apache-2.0
"""The joining of parts as records of a journal: what searches found, and what was decided."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.closure_search import NO_MATCHES
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.graph_records import (
    CANDIDATES,
    MATCHES,
    REQUESTS,
    candidate_columns,
    matches_record,
    recorded_candidates,
)
from cartoloop.global_slam.hypotheses import Candidate
from cartoloop.global_slam.join_evidence import GeometryCheck, Nearby
from cartoloop.journal.fields import FieldReader, pack_columns
from cartoloop.sensor.pose import Pose

_SEARCH = struct.Struct("<Id")
_DECISION = struct.Struct("<2I3dI")
_THRESHOLD = (("<f8",), ((),))


NO_REQUESTS = Requests(
    *(np.zeros((0, *shape), kind) for kind, shape in zip(*REQUESTS, strict=True))
)


NO_NEARBY = Nearby(NO_REQUESTS, NO_MATCHES, np.zeros(0))


class JoinSearch(NamedTuple):
    """What the search of composite scans in one submap of another part came to.

    Attributes
    ----------
    place : of the search among those that were running.
    min_score : the threshold.
    candidates : where it was reached, by pairs that had no row in the record of closures before.
    requests : the window of each candidate.
    """

    place: int
    min_score: float
    candidates: list[Candidate]
    requests: Requests


class JoinDecision(NamedTuple):
    """What was decided about a placement of two parts.

    Attributes
    ----------
    one, other : the parts; `other` is moved if they are joined.
    tf_one_other : the placement.
    check : of the geometry; its fault is why they are not joined.
    found : the closures between them.
    nearby : of the nodes that were searched nearby; none where they are not joined.
    is_joined : whether they are joined now; another place may fit, too.
    """

    one: int
    other: int
    tf_one_other: Pose
    check: GeometryCheck
    found: SearchMatches
    nearby: Nearby
    is_joined: bool


def as_one(parts: Sequence[Nearby]) -> Nearby:
    """Return the matches of several searches as one."""
    requests = zip(NO_REQUESTS, *(each.requests for each in parts), strict=True)
    matches = zip(NO_MATCHES, *(each.matches for each in parts), strict=True)
    return Nearby(
        Requests._make(map(np.concatenate, requests)),
        SearchMatches._make(map(np.concatenate, matches)),
        np.concatenate([np.zeros(0), *(each.min_score for each in parts)]),
    )


def with_rows(nearby: Nearby, closures: Closures, num_nodes: int) -> SearchMatches:
    """Return matches with rows in the record of closures, those of pairs that have none yet.

    Parameters
    ----------
    num_nodes : of the graph at this moment.
    """
    requests, matches, min_score = nearby
    is_new = np.flatnonzero(~closures.has_rows(requests.submap, requests.node))
    rows = closures.request(requests.take(is_new), num_nodes)
    closures.note_searched(rows, min_score[is_new])
    return SearchMatches._make(column[is_new] for column in matches)._replace(row=rows)


def join_searches_record(searches: Sequence[JoinSearch]) -> bytes:
    """Return what searches came to as a payload."""
    parts = []
    for each in searches:
        parts += [
            _SEARCH.pack(each.place, each.min_score),
            pack_columns(candidate_columns(each.candidates), CANDIDATES[0]),
            pack_columns(each.requests, REQUESTS[0]),
        ]
    return b"".join(parts)


def recorded_join_searches(payload: memoryview) -> list[JoinSearch]:
    """Return what :func:`join_searches_record` was given.

    Raises
    ------
    struct.error, ValueError
        The payload is damaged.
    """
    reader = FieldReader(payload)
    searches = []
    while not reader.is_at_end:
        place, min_score = reader.numbers(_SEARCH)
        candidates = recorded_candidates(reader)
        requests = Requests(*reader.columns(*REQUESTS))
        if len(requests.submap) != len(candidates):
            raise ValueError("a search has no window")
        searches.append(JoinSearch(place, min_score, candidates, requests))
    return searches


def join_decision_record(decision: JoinDecision) -> bytes:
    """Return a decision as a payload."""
    check = decision.check
    content = json.dumps(
        [
            float(check.length),
            float(check.contradicted),
            int(check.on_wall),
            int(check.on_floor),
            check.fault,
            decision.is_joined,
            float(check.usual_limit),
        ]
    ).encode()
    head = _DECISION.pack(decision.one, decision.other, *decision.tf_one_other, len(content))
    requests, matches, min_score = decision.nearby
    nearby = (
        pack_columns(requests, REQUESTS[0])
        + matches_record(matches)
        + pack_columns([min_score], _THRESHOLD[0])
    )
    return head + content + matches_record(decision.found) + nearby


def recorded_join_decision(payload: memoryview) -> JoinDecision:
    """Return what :func:`join_decision_record` was given.

    Raises
    ------
    struct.error, ValueError
        The payload is damaged.
    """
    one, other, x, y, theta, length = _DECISION.unpack_from(payload)
    end = _DECISION.size + length
    content = json.loads(bytes(payload[_DECISION.size : end]))
    if not isinstance(content, list) or len(content) not in (5, 6, 7):
        raise ValueError("the examination of a join is damaged")
    path, contradicted, on_wall, on_floor, fault = content[:5]
    # Journals of earlier versions do not state these.
    is_joined = bool(content[5]) if len(content) > 5 else not fault
    usual_limit = float(content[6]) if len(content) > 6 else 0.0
    check = GeometryCheck(
        float(path), float(contradicted), int(on_wall), int(on_floor), str(fault), usual_limit
    )
    placement: FloatArray = np.array((x, y, theta))
    if not np.isfinite(placement).all():
        raise ValueError("a pose is not finite")
    reader = FieldReader(payload[end:])
    found, nearby = SearchMatches(*reader.columns(*MATCHES)), NO_NEARBY
    if not reader.is_at_end:  # journals of earlier versions have none
        requests = Requests(*reader.columns(*REQUESTS))
        matches = SearchMatches(*reader.columns(*MATCHES))
        count = len(matches.row)
        # Earlier versions do not state the thresholds.
        min_score = np.full(count, np.nan) if reader.is_at_end else reader.columns(*_THRESHOLD)[0]
        if not len(requests.submap) == count == len(min_score):
            raise ValueError("a match has no window or no threshold")
        nearby = Nearby(requests, matches, min_score)
    return JoinDecision(one, other, Pose(x, y, theta), check, found, nearby, is_joined)
