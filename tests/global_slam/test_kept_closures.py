# SPDX-License-Identifier: Apache-2.0
"""Which closures of searches stay where the last pass matches fewer pairs."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.kept_closures import with_kept_closures
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.global_slam.sessions import SessionRanges
from tests.global_slam.closures import closure, final_matches, record

NUM_NODES = 6
"""Of each session: three in each of two submaps."""


def graph_of_two_sessions():
    """Two submaps a session; all poses are the origin."""
    graph = PoseGraph()
    for number in range(4):
        graph.add_submap((0.0, 0.0, 0.0))
        nodes = range(3 * number, 3 * number + 3)
        graph.add_nodes([(0.0, 0.0, 0.0)] * 3)
        graph.add_constraints(
            ConstraintKind.INTRA_SUBMAP,
            [number] * 3,
            list(nodes),
            [(0.0, 0.0, 0.0)] * 3,
            [np.eye(3)] * 3,
        )
    return graph


def kept(found, matched=(), reasons=None):
    """Return submap, node and reason of what a pass comes to, given what it matches."""
    sessions = SessionRanges()
    sessions.begin(0, 0)
    sessions.begin(NUM_NODES, 2)
    passes = [
        final_matches(
            [one for one in matched if one.submap == submap],
            [why for one, why in zip(matched, reasons or [], strict=False) if one.submap == submap],
        )
        for submap in range(4)
    ]
    found = record(found=found).found
    done = with_kept_closures(passes, found, graph_of_two_sessions(), sessions)
    return [
        (submap, node, Reason(reason))
        for each in done
        for submap, node, reason in zip(
            each.submap.tolist(), each.node.tolist(), each.reason.tolist(), strict=True
        )
    ]


def test_closures_between_sessions_stay_where_none_matches():
    assert kept([closure(1, 6), closure(1, 7)]) == [(1, 6, Reason.KEPT), (1, 7, Reason.KEPT)]


def test_matches_that_do_not_fit_are_replaced():
    matched = [closure(1, 6), closure(1, 9)]
    assert kept([closure(1, 6)], matched, [Reason.RESIDUAL, Reason.FITS]) == [
        (1, 9, Reason.FITS),
        (1, 6, Reason.KEPT),
    ]


@pytest.mark.parametrize("match", [closure(1, 8), closure(2, 4)])
def test_closures_go_where_as_many_match(match):
    done = kept([closure(1, 6)], [match], [Reason.FITS])
    assert done == [(match.submap, match.node, Reason.FITS)]


def test_closures_within_a_session_do_not_stay():
    assert kept([closure(0, 5)]) == []


@pytest.mark.parametrize("pose", [(0.25, 0.0, 0.0), (0.0, 0.0, 0.02)])
def test_closures_that_the_poses_contradict_do_not_stay(pose):
    assert kept([closure(1, 6, pose)]) == []
