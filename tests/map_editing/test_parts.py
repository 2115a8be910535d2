# SPDX-License-Identifier: Apache-2.0
"""Parts of a map that are apart are joined by a closure that is added, until it is undone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cartoloop.errors import InputError
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.map_editing.editor import Editor
from cartoloop.sensor.pose import compose_all
from cartoloop.session import Session

AWAY = np.array((300.0, -40.0, 2.0))


@pytest.fixture
def apart(ring_result):
    """The ring in two sessions: the second one is elsewhere, and no closure connects them."""
    graph = ring_result.graph.copy()
    first = graph.num_submaps - 2
    own = graph.kinds == ConstraintKind.INTRA_SUBMAP
    node = int(graph.index_b[own & (graph.index_a >= first)].min())
    is_across = (graph.index_a >= first) != (graph.index_b >= node)
    graph.remove(is_across)
    graph.submap_poses[first:] = compose_all(AWAY, graph.submap_poses[first:])
    graph.node_poses[node:] = compose_all(AWAY, graph.node_poses[node:])
    scan = int(ring_result.node_scan_index[node])
    sessions = (Session("a"), Session("b", "", "", scan, node, first, part=1))
    return replace(ring_result, graph=graph, sessions=sessions)


def pair_across(result, apart):
    """A closure of the ring between the two sessions."""
    graph, first = result.graph, apart.sessions[1]
    across = (graph.kinds == ConstraintKind.LOOP_CLOSURE) & (graph.index_b >= first.first_node)
    rows = np.flatnonzero(across & (graph.index_a < first.first_submap))
    row = rows[len(rows) // 2]  # those at the ends overlap little
    return int(graph.index_a[row]), int(graph.index_b[row])


def test_a_closure_between_parts_joins_them(ring_result, apart):
    submap, node = pair_across(ring_result, apart)
    one = Editor(apart)
    one.add_closure(submap, node, ring_result.graph.node_poses[node])

    assert [session.part for session in one.map.sessions] == [0, 0]
    apart_m = np.hypot(*(one.map.graph.node_poses - ring_result.graph.node_poses)[:, :2].T)
    assert apart_m.max() < 0.5
    one.undo()
    assert [session.part for session in one.map.sessions] == [0, 1]
    assert np.array_equal(one.map.graph.node_poses, apart.graph.node_poses)


def test_the_map_moves_without_what_is_apart(apart):
    one = Editor(apart)
    first = apart.sessions[1].first_node
    one.set_control_points([(0, 0, 5, 5), (10, 0, 5, 15)])

    assert np.array_equal(one.map.graph.node_poses[first:], apart.graph.node_poses[first:])
    assert np.abs(one.map.graph.node_poses[0] - apart.graph.node_poses[0]).max() > 1.0


def test_what_is_apart_is_not_pinned(apart):
    with pytest.raises(InputError, match="is in part 1, which is apart from the map"):
        Editor(apart).pin_node(apart.sessions[1].first_node)
