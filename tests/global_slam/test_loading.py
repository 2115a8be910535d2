# SPDX-License-Identifier: Apache-2.0
"""Maps as the beginning of another: their graphs and their records of closures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cartoloop.config import Config
from cartoloop.earlier_sessions import EarlierMaps, whole_trajectory, with_parts
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.global_slam.loading import load, settled
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.global_slam.submap_paths import FAR_M
from cartoloop.runtime.stage_timer import StageTimer


@pytest.fixture(scope="module")
def mapped(two_rounds_result):
    return EarlierMaps([two_rounds_result]).mapped[0]


@pytest.fixture(scope="module")
def loaded(mapped):
    return load([mapped, mapped])


def test_graphs_follow_each_other(loaded, two_rounds_result):
    graph, whole = two_rounds_result.graph, loaded.graph
    nodes, submaps, constraints = graph.num_nodes, graph.num_submaps, graph.num_constraints
    assert (whole.num_nodes, whole.num_submaps) == (2 * nodes, 2 * submaps)
    for half, first_node, first_submap in ((0, 0, 0), (1, nodes, submaps)):
        rows = slice(half * constraints, (half + 1) * constraints)
        np.testing.assert_array_equal(whole.index_a[rows] - first_submap, graph.index_a)
        np.testing.assert_array_equal(whole.index_b[rows] - first_node, graph.index_b)
        np.testing.assert_array_equal(whole.relative_poses[rows], graph.relative_poses)
        np.testing.assert_array_equal(whole.informations[rows], graph.informations)
    assert whole.fixed_submaps == graph.fixed_submaps


def test_closures_of_the_graph_are_in_the_record(loaded):
    graph, closures = loaded.graph, loaded.closures
    own = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    rows = graph.closure_rows[own]
    np.testing.assert_array_equal(closures.submap[rows], graph.index_a[own])
    np.testing.assert_array_equal(closures.node[rows], graph.index_b[own])
    assert np.all(closures.status[rows] == Status.FOUND)
    measured = closures.measured
    place = np.searchsorted(measured.row, rows)
    np.testing.assert_array_equal(measured.row[place], rows)
    np.testing.assert_array_equal(measured.tf_submap_node[place], graph.relative_poses[own])


def test_requests_keep_their_history(mapped, two_rounds_result):
    record, _ = settled(mapped.closures, mapped.graph)
    before = two_rounds_result.closures
    count = before.num_requested
    np.testing.assert_array_equal(record.ends[0][:count], before.submap[:count])
    np.testing.assert_array_equal(record.codes[2][:count], before.search_status[:count])
    np.testing.assert_array_equal(record.requests.linear_window[:count], before.linear_window)
    assert np.all(record.codes[1][count:] == Reason.EARLIER_PASS)


def test_settling_a_settled_record_changes_nothing(mapped):
    once = load([mapped])
    again = load([replace(mapped, graph=once.graph, closures=once.closures)])
    for name, column in once.closures.stored().items():
        np.testing.assert_array_equal(again.closures.stored()[name], column, err_msg=name)
    np.testing.assert_array_equal(again.graph.closure_rows, once.graph.closure_rows)


def test_parts_of_maps_get_numbers_of_their_own(loaded):
    assert loaded.ranges.parts == [0, 1]
    assert loaded.ranges.of_nodes(loaded.graph.num_nodes)[[0, -1]].tolist() == [0, 1]
    loaded.ranges.begin(loaded.graph.num_nodes, loaded.graph.num_submaps)
    assert loaded.ranges.parts == [0, 1, 2]
    loaded.ranges.join(2, 0)
    assert loaded.ranges.parts == [0, 1, 0]
    loaded.ranges.parts.pop()
    loaded.ranges.first_nodes.pop()
    loaded.ranges.first_submaps.pop()


def test_no_path_leads_from_one_session_to_another(mapped):
    slam = GlobalSlam(Config().global_slam, StageTimer(), mapped=[mapped, mapped])
    submaps, nodes = mapped.graph.num_submaps, mapped.graph.num_nodes
    selection = slam._pairs
    assert selection.path_length(slam.graph, 0, nodes - 1) < FAR_M
    assert selection.path_length(slam.graph, 0, nodes) > FAR_M
    assert selection.path_length(slam.graph, submaps, 0) > FAR_M
    assert len(selection.of_node(slam.graph, nodes, submaps).submap) == 0
    slam.close()


def test_composite_scans_are_of_one_session(mapped):
    slam = GlobalSlam(Config().global_slam, StageTimer(), mapped=[mapped, mapped])
    scans, nodes = slam._wide.scans, mapped.graph.num_nodes
    first, second = (scans.nodes[scans.nodes < nodes], scans.nodes[scans.nodes >= nodes])
    np.testing.assert_array_equal(first, second - nodes)
    for one, other in zip(range(len(first)), range(len(first), len(scans)), strict=True):
        np.testing.assert_array_equal(scans.points[one], scans.points[other])
    slam.close()


def test_trajectory_is_interpolated_within_sessions(two_rounds_result):
    earlier = EarlierMaps([two_rounds_result, two_rounds_result])
    loaded = load(earlier.mapped)
    sessions = with_parts(earlier.sessions, loaded.ranges)
    whole = whole_trajectory(
        sessions, earlier.local_poses, earlier.node_scan_index, loaded.graph.node_poses
    )
    count = len(two_rounds_result.stamps)
    np.testing.assert_array_equal(whole[:count], two_rounds_result.trajectory)
    np.testing.assert_array_equal(whole[count:], two_rounds_result.trajectory)
