# SPDX-License-Identifier: Apache-2.0
"""Control points, links between sessions and fixed poses against a dense solver."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust, graph_problem
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.kernels.pose_adjustment.losses import DECIDED
from cartoloop.pose_adjustment import GroupLoss, Loss, control_points, plan, solve
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles
from tests.global_slam.bipartite_graph import all_poses, walk
from tests.reference import naive_pose_adjustment as naive

seeds = st.integers(0, 2**32 - 1)
TO_THE_END = {"relative_tolerance": 1e-13, "max_iterations": 300}
SITE = np.array([40.0, -12.0, 0.2])  # the walk's frame in the map: what surveyed points define
OBLIQUE = np.array([[4e-4, 1e-4], [1e-4, 9e-4]])


def surveyed(true_nodes, nodes, *, sigma=0.0, seed=0):
    """Return the positions of nodes of a walk on the site, measured with noise."""
    positions = compose_all(SITE, true_nodes[nodes])[:, :2]
    return positions + np.random.default_rng(seed).normal(0.0, sigma, positions.shape)


def without_group_loss(graph):
    return [GroupLoss()] * len(ConstraintKind)


def assert_same_poses(ours, expected, tolerance):
    difference = ours - expected
    difference[:, 2] = wrap_angles(difference[:, 2])
    np.testing.assert_allclose(difference, 0.0, atol=tolerance)


def solved(graph, points, losses=None):
    losses = losses or without_group_loss(graph)
    return solve(plan(graph_problem(graph, points)), losses, **TO_THE_END)


@given(seeds, st.booleans(), st.integers(0, 4))
@settings(deadline=None, max_examples=15)
def test_control_points_give_the_dense_solution(seed, with_angles, num_odometry):
    graph, _, nodes = walk(12, 3, 6, seed=seed, num_odometry=num_odometry)
    rng = np.random.default_rng(seed)
    chosen = rng.choice(12, 4, replace=False)
    measured = nodes[chosen] + rng.normal(0.0, 0.05, (4, 3))
    if with_angles:
        half = rng.normal(size=(4, 3, 3))
        points = control_points(
            chosen, measured, 1e-3 * (half @ half.transpose(0, 2, 1) + np.eye(3)), group=2
        )
    else:
        points = control_points(chosen, measured[:, :2], OBLIQUE, group=2)
    poses, cost = naive.minimize(graph, (), naive.measurements(graph, points))
    result = solved(graph, points)
    assert result.cost == pytest.approx(cost, rel=1e-8)
    assert_same_poses(np.concatenate((result.submap_poses, result.node_poses)), poses, 1e-4)


@pytest.mark.parametrize("loss", [Loss.HUBER, Loss.CAUCHY, *sorted(DECIDED)])
def test_each_group_has_its_own_loss_and_scale(loss):
    graph, _, nodes = walk(60, 6, 20, seed=1)
    chosen = np.arange(0, 60, 6)
    measured = nodes[chosen, :2].copy()
    measured[3] += (5.0, -3.0)  # a wrong control point
    points = control_points(chosen, measured, 0.02**2 * np.eye(2), group=3)
    losses = [*without_group_loss(graph), GroupLoss(loss, 2.0)]
    result = solved(graph, points, losses)
    np.testing.assert_array_equal(result.weights, 1.0)
    assert result.control_weights[3] < 0.05
    assert np.delete(result.control_weights, 3).min() > 0.5
    poses = np.concatenate((result.submap_poses, result.node_poses))
    pairs = [(group.loss, group.scale or 1.0) for group in losses]
    expected = naive.cost_of(naive.measurements(graph, points, pairs), poses)
    assert result.cost == pytest.approx(expected, rel=1e-9)
    # the influence of a wrong point never vanishes with Huber's loss
    limit = 0.5 if loss is Loss.HUBER else 0.1
    assert np.hypot(*(result.node_poses - nodes)[:, :2].T).max() < limit


def test_surveyed_points_move_the_map_into_their_frame():
    graph, _, nodes = walk(300, 15, 80, seed=2, noise=(0.001, 0.0002))
    chosen = np.array([0, 120, 299])
    points = control_points(chosen, surveyed(nodes, chosen, sigma=0.01), 0.01**2 * np.eye(2))
    adjust(graph, AdjustmentOptions(**TO_THE_END), points)
    expected = compose_all(SITE, nodes)
    assert np.hypot(*(graph.node_poses - expected)[:, :2].T).max() < 0.1


def test_a_single_position_moves_one_node_there():
    graph = walk(60, 6, 20, seed=1).graph
    expected = adjust(walk(60, 6, 20, seed=1).graph, AdjustmentOptions(**TO_THE_END)).cost
    points = control_points([30], [(5.0, 7.0)], 1e-6 * np.eye(2))
    result = adjust(graph, AdjustmentOptions(**TO_THE_END), points)
    np.testing.assert_allclose(graph.node_poses[30, :2], (5.0, 7.0), atol=1e-6)
    assert result.cost == pytest.approx(expected, rel=1e-6)


def two_sessions(seed):
    """Return a graph of two walks along the same path, and the true poses of its nodes."""
    first, second = walk(60, 6, 20, seed=seed), walk(60, 6, 20, seed=seed)
    graph = PoseGraph()
    elsewhere = np.array([0.4, -0.3, 0.05])
    for offset, session in ((np.zeros(3), first), (elsewhere, second)):
        submaps, nodes = graph.num_submaps, graph.num_nodes
        graph.add_submaps(compose_all(offset, session.graph.submap_poses))
        graph.add_nodes(compose_all(offset, session.graph.node_poses))
        graph.add_constraints(
            session.graph.kinds,
            session.graph.index_a + submaps,
            session.graph.index_b + nodes,
            session.graph.relative_poses,
            session.graph.informations,
        )
    return graph, np.concatenate((first.nodes, second.nodes))


def test_links_join_a_session_to_one_that_is_fixed():
    graph, nodes = two_sessions(4)
    for submap in range(6):
        graph.submap_poses[submap] = walk(60, 6, 20, seed=4).submaps[submap]
        graph.fix_submap(submap)
    graph.node_poses[:60] = nodes[:60]
    for node in range(60):
        graph.fix_node(node)
    for node in (5, 25, 55):
        relative = relative_all(nodes[node], nodes[60 + node])[0]
        graph.add_constraint(
            ConstraintKind.NODE_TO_NODE, node, 60 + node, relative, np.diag([1e4, 1e4, 1e5])
        )
    before = all_poses(graph)
    result = adjust(graph, AdjustmentOptions(loss=Loss.NONE, **TO_THE_END))
    np.testing.assert_array_equal(graph.submap_poses[:6], before[:6])
    np.testing.assert_array_equal(graph.node_poses[:60], nodes[:60])
    assert np.hypot(*(graph.node_poses - nodes)[:, :2].T).max() < 0.1
    held = (*range(6), *range(12, 72))
    graph.submap_poses[:], graph.node_poses[:] = before[:12], before[12:]
    assert result.cost == pytest.approx(naive_cost(graph, held), rel=1e-8)


def naive_cost(graph, held):
    return naive.minimize(graph, held, naive.measurements(graph), max_iterations=6)[1]


@given(seeds)
@settings(deadline=None, max_examples=10)
def test_any_fixed_poses_give_the_dense_solution(seed):
    graph = walk(12, 3, 6, seed=seed, num_odometry=2).graph
    rng = np.random.default_rng(seed)
    submap, *nodes = rng.integers(3), *rng.choice(12, 2, replace=False)
    graph.fix_submap(int(submap))
    for node in nodes:
        graph.fix_node(int(node))
    held = {int(submap), *(3 + int(node) for node in nodes)}
    _, cost = naive.minimize(graph, held, naive.measurements(graph))
    before = all_poses(graph)
    result = solved(graph, None)
    assert result.cost == pytest.approx(cost, rel=1e-8)
    after = np.concatenate((result.submap_poses, result.node_poses))
    np.testing.assert_array_equal(after[sorted(held)], before[sorted(held)])


@pytest.mark.parametrize(
    ("measured", "covariance", "message"),
    [
        ([(1.0, 2.0)], np.diag([1.0, 0.0]), "positive definite"),
        ([(1.0, 2.0)], np.array([[1.0, 0.5], [0.0, 1.0]]), "symmetric"),
        ([(1.0, np.nan)], np.eye(2), "not finite"),
        ([(1.0, 2.0, 3.0, 4.0)], np.eye(4), "2 or 3 coordinates"),
    ],
)
def test_an_impossible_control_point_is_refused(measured, covariance, message):
    with pytest.raises(ValueError, match=message):
        control_points([0], measured, covariance)


def test_unknown_vertices_and_groups_are_refused():
    graph = walk(12, 3, 6).graph
    with pytest.raises(IndexError, match="node 12"):
        plan(graph_problem(graph, control_points([12], [(0.0, 0.0)], np.eye(2))))
    points = control_points([3], [(0.0, 0.0)], np.eye(2), group=5)
    with pytest.raises(ValueError, match="6 groups, but 3 have a loss"):
        solve(plan(graph_problem(graph, points)), without_group_loss(graph))
    problem = graph_problem(graph)
    problem.constraints.index_b[4] = 99
    with pytest.raises(IndexError, match="constraint 4"):
        plan(problem)
