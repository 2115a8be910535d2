# SPDX-License-Identifier: Apache-2.0
"""Decisions about joins as records of a journal, also those of earlier versions."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.graph_records import matches_record
from cartoloop.global_slam.join_evidence import GeometryCheck, Nearby
from cartoloop.global_slam.join_records import (
    _DECISION,
    NO_NEARBY,
    JoinDecision,
    join_decision_record,
    recorded_join_decision,
    with_rows,
)
from cartoloop.sensor.pose import Pose

CHECK = GeometryCheck(20.0, 1.0, 900, 30, "")


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
    return Nearby(Requests(submaps, nodes, submaps + 1, *windows), matches(count))


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
        *zip(found.nearby, given.nearby, strict=True),
    ):
        for one, other in zip(read, recorded, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("fault", ["", "a wall"])
def test_decisions_of_earlier_versions_are_read(fault):
    content = json.dumps([*CHECK[:4], fault]).encode()
    head = _DECISION.pack(0, 2, 1.0, 2.0, 0.5, len(content))
    old = head + content + matches_record(matches(4, 7))
    found = recorded_join_decision(memoryview(old))
    assert found.is_joined is (fault == "")
    assert len(found.nearby.matches.row) == 0
    assert len(found.found.row) == 4


def test_pairs_that_have_a_row_are_left_out():
    closures = Closures()
    closures.request(nearby((3, 40)).requests, 100)
    found = with_rows(nearby((3, 40), (3, 44), (5, 40)), closures, 100, 0.38)
    assert found.row.tolist() == [1, 2]
    np.testing.assert_array_equal(found.score, matches(3).score[1:])
    assert closures.node[found.row].tolist() == [44, 40]
