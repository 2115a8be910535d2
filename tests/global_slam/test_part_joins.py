# SPDX-License-Identifier: Apache-2.0
"""A placement is examined once while neither its evidence nor the graph changes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cartoloop.config import GlobalSlamConfig
from cartoloop.global_slam import part_joins
from cartoloop.global_slam.claims import Claim
from cartoloop.global_slam.hypotheses import Candidate
from cartoloop.global_slam.join_evidence import (
    GeometryCheck,
    JoinAttempt,
    Strictness,
    TwoParts,
)
from cartoloop.global_slam.join_records import NO_MATCHES, NO_NEARBY
from cartoloop.global_slam.part_joins import PartJoins
from cartoloop.global_slam.placing import Placement
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.global_slam.sessions import SessionRanges
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.scan_points import ScanPoints


def attempt(x=1.0, scan=0, strictness=Strictness.NO_OTHER_PLACE):
    """An attempt to join parts 0 and 1, supported by one match."""
    candidate = Candidate(scan, scan, 0, np.array([x, 0.0, 0.0]), 0.6, 0.4)
    claim = Claim(candidate, np.array([x, 0.0, 0.0]), np.zeros(3), 0.2)
    found = Placement((claim,), Pose(x, 0.0, 0.0), 0.2, 0.0, 0.0)
    return JoinAttempt(0, 1, found, strictness=strictness)


@pytest.fixture
def two_parts():
    """A graph of one submap and a node in each of two parts."""
    graph = PoseGraph()
    graph.add_submaps([(0.0, 0.0, 0.0)] * 2)
    graph.add_nodes([(0.0, 0.0, 0.0)] * 2)
    return TwoParts(graph, [], ScanPoints.of([]), np.array([0, 1]), np.array([0, 1]))


@pytest.fixture
def examine(two_parts, monkeypatch):
    """Examine an attempt; `examine.checks` has the strictness of each examination that was made."""
    checks = []

    def check(_, strictness):
        checks.append(strictness)
        return GeometryCheck(9.0, 9.0, len(checks), 0, "they contradict each other")

    monkeypatch.setattr(part_joins, "tentative_joins", lambda *_: [(two_parts, NO_NEARBY)])
    scans = SimpleNamespace(nodes=np.arange(2))
    joins = PartJoins(GlobalSlamConfig(), None, [], None, scans, SessionRanges(), check)

    def call(one):
        return joins._examined(one, NO_MATCHES, two_parts)

    call.checks = checks
    return call


def test_a_placement_is_examined_once(examine):
    first = examine(attempt())

    assert examine(attempt()) == first
    assert len(examine.checks) == 1


@pytest.mark.parametrize(
    "other", [{"x": 1.1}, {"scan": 1}, {"strictness": Strictness.FEW_DISTINCT}], ids=str
)
def test_other_evidence_is_examined(examine, other):
    examine(attempt())
    examine(attempt(**other))

    assert len(examine.checks) == 2


@pytest.mark.parametrize("change", ["node", "submap", "constraint"])
def test_a_graph_that_has_changed_is_examined_again(examine, two_parts, change):
    examine(attempt())
    graph = two_parts.graph
    if change == "node":
        graph.node_poses[1, 0] += 1e-9
    elif change == "submap":
        graph.submap_poses[1, 2] += 1e-9
    else:
        kind = ConstraintKind.INTRA_SUBMAP
        graph.add_constraints(kind, [0], [0], [(0.0, 0.0, 0.0)], [np.eye(3)])
    examine(attempt())

    assert len(examine.checks) == 2
