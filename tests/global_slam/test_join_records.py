# SPDX-License-Identifier: Apache-2.0
"""Decisions about joins as records of a journal, also those of earlier versions."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.graph_records import REQUESTS, matches_record
from cartoloop.global_slam.join_evidence import GeometryCheck, Nearby
from cartoloop.global_slam.join_records import (
    _DECISION,
    NO_NEARBY,
    JoinDecision,
    join_decision_record,
    recorded_join_decision,
    with_rows,
)
from cartoloop.journal.fields import pack_columns
from cartoloop.sensor.pose import Pose

CHECK = GeometryCheck(20.0, 1.0, 900, 30, "", 0.11)


def matches(count, row=-1):
    column = np.linspace(0.1, 0.9, count)
    return SearchMatches(
        np.full(count, row, np.int32),
        np.ones((count, 3)),
        np.tile(np.eye(3), (count, 1, 1)),
        *[column] * 5,
    )


def nearby(*pairs):
    submaps, nodes = np.array(pairs, dtype=np.int32).T
    count = len(pairs)
    windows = (np.zeros((count, 3)), np.full(count, 0.5), np.full(count, 0.1))
    scores = np.linspace(0.3, 0.38, count)
    return Nearby(Requests(submaps, nodes, submaps + 1, *windows), matches(count), scores)


def decision(searched=NO_NEARBY, *, is_joined=True):
    return JoinDecision(0, 2, Pose(1.0, 2.0, 0.5), CHECK, matches(4, 7), searched, is_joined)


@pytest.mark.parametrize("is_joined", [True, False])
def test_decisions_are_read_as_recorded(is_joined):
    given = decision(nearby((3, 40), (3, 44)), is_joined=is_joined)
    found = recorded_join_decision(memoryview(join_decision_record(given)))
    assert found[:4] == given[:4]
    assert found.is_joined is is_joined
    for read, recorded in (
        (found.found, given.found),
        *zip(found.nearby[:2], given.nearby[:2], strict=True),
        ((found.nearby.min_score,), (given.nearby.min_score,)),
    ):
        for one, other in zip(read, recorded, strict=True):
            np.testing.assert_array_equal(one, other)


def head_of(content):
    text = json.dumps(content).encode()
    return _DECISION.pack(0, 2, 1.0, 2.0, 0.5, len(text)) + text


def test_decisions_without_thresholds_are_read():
    searched = nearby((3, 40), (3, 44))
    columns = pack_columns(searched.requests, REQUESTS[0]) + matches_record(searched.matches)
    old = head_of([*CHECK[:4], "", True]) + matches_record(matches(4, 7)) + columns
    found = recorded_join_decision(memoryview(old))
    assert found.check == CHECK._replace(usual_limit=0.0)
    assert np.isnan(found.nearby.min_score).tolist() == [True, True]


def test_decisions_with_too_few_thresholds_are_refused():
    given = decision(nearby((3, 40), (3, 44)))
    short = given.nearby._replace(min_score=np.array([0.3]))
    with pytest.raises(ValueError, match="no threshold"):
        recorded_join_decision(memoryview(join_decision_record(given._replace(nearby=short))))


@pytest.mark.parametrize("fault", ["", "a wall"])
def test_decisions_of_earlier_versions_are_read(fault):
    old = head_of([*CHECK[:4], fault]) + matches_record(matches(4, 7))
    found = recorded_join_decision(memoryview(old))
    assert found.is_joined is (fault == "")
    assert len(found.nearby.matches.row) == 0
    assert len(found.found.row) == 4


def test_pairs_that_have_a_row_are_left_out():
    closures = Closures()
    closures.request(nearby((3, 40)).requests, 100)
    found = with_rows(nearby((3, 40), (3, 44), (5, 40)), closures, 100)
    assert found.row.tolist() == [1, 2]
    np.testing.assert_array_equal(found.score, matches(3).score[1:])
    assert closures.node[found.row].tolist() == [44, 40]
    np.testing.assert_allclose(closures.min_score[1:], [0.34, 0.38])
