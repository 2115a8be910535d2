# SPDX-License-Identifier: Apache-2.0
"""Decisions about joins in a journal: parts are placed where they were joined, and only then."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import Config
from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.hypotheses import Candidate
from cartoloop.global_slam.join_evidence import GeometryCheck, Nearby
from cartoloop.global_slam.join_records import (
    JoinDecision,
    JoinSearch,
    join_decision_record,
    join_searches_record,
)
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.global_slam.sessions import MappedSessions
from cartoloop.journal.frames import Kind, Record
from cartoloop.map_file.journal_records import JournalRecords
from cartoloop.map_file.run_header import RunHeader
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.session import Session
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.node import Node
from cartoloop.submaps.node_records import node_record, scan_record
from cartoloop.submaps.probability_grid import ProbabilityGrid
from cartoloop.submaps.submap import Submap

POINTS = np.array([(2.0, 0.0), (0.0, 1.5), (-1.0, -1.0)])
GRID = FinishedGrid(np.full((4, 6), 9, np.uint8), -1.0, -2.0, 0.05)
PLACED = Pose(3.0, -4.0, np.pi / 2)
HEADER = RunHeader("map", "b.log", "0123", Config(), continues=True, first_node=1, first_submap=1)


def earlier():
    """Return a map of one node and one submap."""
    graph = PoseGraph()
    graph.add_submap((0.0, 0.0, 0.0))
    graph.add_nodes([(0.0, 0.0, 0.0)])
    graph.add_constraints(ConstraintKind.INTRA_SUBMAP, [0], [0], [(0.0, 0.0, 0.0)], [np.eye(3)])
    return MappedSessions([Session()], graph, [GRID], [POINTS], np.zeros((1, 3)), Closures())


def matches(*rows):
    count = len(rows)
    poses = np.tile((1.0, 0.5, 0.1), (count, 1))
    scores = [np.full(count, 0.5)] * 5
    return SearchMatches(
        np.array(rows, np.int32), poses, np.tile(np.eye(3), (count, 1, 1)), *scores
    )


def requests(submap, node):
    ends = [np.array([each], np.int32) for each in (submap, node, 1 - submap)]
    return Requests(*ends, np.zeros((1, 3)), np.full(1, 0.5), np.full(1, 0.1))


@pytest.fixture
def records():
    """Return a journal of a session of two nodes; one is matched in the map before."""
    records = JournalRecords(100_000, HEADER, earlier())
    submap = Submap(1, Pose(5.0, 0.0, 0.0), ProbabilityGrid(0.05))
    for number in (1, 2):
        pose = Pose(5.0 + number, 0.0, 0.0)
        made = Node(number, float(number), pose, POINTS, (submap,), np.eye(3), None)
        add(records, Kind.NODE, node_record(made, IDENTITY))
        add(records, Kind.SCAN, scan_record(float(number), pose))
    found = Candidate(0, 0, 0, np.array((1.0, 0.5, 0.1)), 0.5, 0.2)
    search = JoinSearch(0, 0.38, [found], requests(0, 1))
    add(records, Kind.JOIN_SEARCHED, join_searches_record([search]))
    return records


def add(records, kind, payload):
    records.add(Record(kind, memoryview(payload)))


def decide(records, *, is_joined, fault="", other=1):
    nearby = Nearby(requests(0, 2), matches(-1), np.array([0.31]))
    check = GeometryCheck(20.0, 1.0, 900, 30, fault)
    decision = JoinDecision(0, other, PLACED, check, matches(0), nearby, is_joined)
    add(records, Kind.JOIN_DECIDED, join_decision_record(decision))


def test_parts_are_placed_where_they_were_joined(records):
    decide(records, is_joined=True)
    assert records.loaded.ranges.parts == [0, 0]
    np.testing.assert_allclose(records.submap_poses[1], (3.0, 1.0, np.pi / 2))
    assert [(found.row.tolist(), trusted) for found, trusted in records.found] == [
        ([0], True),
        ([1], False),
    ]
    np.testing.assert_allclose(records.closures.min_score, [0.38, 0.31])


@pytest.mark.parametrize("fault", ["", "a wall contradicts it"])
def test_parts_stay_where_nothing_was_decided(records, fault):
    before = records.submap_poses
    decide(records, is_joined=False, fault=fault)
    assert records.loaded.ranges.parts == [0, 1]
    np.testing.assert_array_equal(records.submap_poses, before)
    assert records.found == []
    assert len(records.closures) == 1


def test_joins_of_unknown_parts_are_refused(records):
    with pytest.raises(ValueError, match="no part"):
        decide(records, is_joined=True, other=7)
