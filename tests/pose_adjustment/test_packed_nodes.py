# SPDX-License-Identifier: Apache-2.0
"""A graph that is packed while it grows is adjusted as if it had been packed at once."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.global_slam.pose_adjustment import (
    AdjustmentOptions,
    PoseAdjuster,
    adjust,
    graph_problem,
)
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.kernels.pose_adjustment.layout import LANES, WINDOW
from cartoloop.pose_adjustment import Loss
from cartoloop.pose_adjustment.packed_nodes import PackedNodes
from tests.global_slam.bipartite_graph import all_poses, walk

seeds = st.integers(0, 2**32 - 1)


def in_parts(graph, num_parts, seed):
    """Yield a graph that grows to one with the constraints of `graph` in a random order."""
    rng = np.random.default_rng(seed)
    grown = PoseGraph()
    grown.add_submaps(graph.submap_poses)
    grown.add_nodes(graph.node_poses)
    for part in np.array_split(rng.permutation(graph.num_constraints), num_parts):
        grown.add_constraints(
            graph.kinds[part],
            graph.index_a[part],
            graph.index_b[part],
            graph.relative_poses[part],
            graph.informations[part],
        )
        yield grown


@given(seeds, st.integers(1, 6), st.sampled_from([0, 12]))
@settings(deadline=None, max_examples=15)
def test_a_graph_that_grew_is_adjusted_to_the_same_bytes(seed, num_parts, num_odometry):
    source = walk(700, 20, 300, seed=seed, num_odometry=num_odometry).graph
    adjuster = None
    for grown in in_parts(source, num_parts, seed):
        adjuster = adjuster or PoseAdjuster(grown)
        before = all_poses(grown)
        result = adjuster.adjust(AdjustmentOptions(max_iterations=2))
        after = all_poses(grown)
        grown.submap_poses[:] = before[: grown.num_submaps]
        grown.node_poses[:] = before[grown.num_submaps :]
        afresh = adjust(grown, AdjustmentOptions(max_iterations=2))
        np.testing.assert_array_equal(all_poses(grown), after)
        np.testing.assert_array_equal(afresh.weights, result.weights)
        assert afresh.cost == result.cost


def test_nodes_added_between_two_runs_are_adjusted():
    whole = walk(2 * WINDOW + 9, 12, 80, seed=3).graph
    graph = PoseGraph()
    graph.add_submaps(whole.submap_poses)
    adjuster = PoseAdjuster(graph)
    for nodes in np.array_split(np.arange(whole.num_nodes), 5):
        graph.add_nodes(whole.node_poses[nodes])
        new = np.isin(whole.index_b, nodes)
        graph.add_constraints(
            whole.kinds[new],
            whole.index_a[new],
            whole.index_b[new],
            whole.relative_poses[new],
            whole.informations[new],
        )
        adjuster.adjust()
    options = AdjustmentOptions(relative_tolerance=1e-12, max_iterations=100)
    assert adjuster.adjust(options).cost == pytest.approx(adjust(whole, options).cost, rel=1e-9)


def test_a_node_that_is_linked_later_is_not_eliminated():
    graph = walk(60, 6, 20, seed=1).graph
    adjuster = PoseAdjuster(graph)
    adjuster.adjust()
    graph.add_constraint(ConstraintKind.NODE_TO_NODE, 3, 30, (5.0, 1.0, 0.3), 1e4 * np.eye(3))
    graph.fix_node(50)
    fixed = graph.node_poses[50].copy()
    expected = walk(60, 6, 20, seed=1).graph
    expected.add_constraint(ConstraintKind.NODE_TO_NODE, 3, 30, (5.0, 1.0, 0.3), 1e4 * np.eye(3))
    expected.fix_node(50)
    expected.node_poses[50] = fixed
    options = AdjustmentOptions(relative_tolerance=1e-12, max_iterations=100)
    assert adjuster.adjust(options).cost == pytest.approx(adjust(expected, options).cost, rel=1e-9)
    np.testing.assert_array_equal(graph.node_poses[50], fixed)


@pytest.mark.parametrize("loss", [Loss.NONE, Loss.HUBER])
def test_stale_rows_are_dropped(loss):
    source = walk(4 * WINDOW, 30, 900, seed=5).graph
    adjuster = None
    for grown in in_parts(source, 40, 5):
        adjuster = adjuster or PoseAdjuster(grown)
        adjuster.adjust(AdjustmentOptions(loss, max_iterations=1))
    rows = adjuster._planners[1.0]._packed.layout.rows.ids
    assert rows.size < 6 * grown.num_constraints


def test_each_constraint_has_a_lane_and_spare_lanes_repeat():
    graph = walk(300, 10, 150, seed=2).graph
    packed = PackedNodes(np.zeros(0, dtype=np.int64))
    packed.extend(graph_problem(graph))
    layout = packed.layout
    ids, slots, measured = layout.rows.ids, layout.slots, layout.rows.measured
    assert sorted(ids[ids >= 0].tolist()) == list(range(graph.num_constraints))
    ends = layout.slot_ends[slots]
    np.testing.assert_array_equal(ends[..., 0], ends[..., 1])
    np.testing.assert_array_equal(ends[ids >= 0, 0], graph.index_a[ids[ids >= 0]])
    lanes = measured.reshape(len(ids), 9, LANES)
    row, lane = np.nonzero(ids >= 0)
    np.testing.assert_array_equal(lanes[row, :3, lane], graph.relative_poses[ids[row, lane]])
    row, lane = np.nonzero(ids < 0)
    np.testing.assert_array_equal(lanes[row, :, lane], lanes[row, :, 0])
