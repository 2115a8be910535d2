# SPDX-License-Identifier: Apache-2.0
"""The pose graph keeps what it is given and refuses what cannot be."""

import numpy as np
import pytest

from cartoloop.global_slam.pose_graph import ClosureConstraints, ConstraintKind, PoseGraph

INTRA, CLOSURE, BETWEEN_NODES = ConstraintKind


def small_graph():
    graph = PoseGraph()
    graph.add_submap((0.0, 0.0, 0.0))
    graph.add_nodes([(0.0, 0.0, 0.0), (1.0, 0.0, 0.1)])
    return graph


def test_index_and_value_stay_while_the_graph_grows():
    graph = PoseGraph()
    rng = np.random.default_rng(0)
    poses, measured = rng.normal(size=(200, 3)), rng.normal(size=(200, 3))
    graph.add_submap((1.0, 2.0, 3.0))
    for i in range(200):
        assert graph.add_node(poses[i]) == i
        information = (i + 1.0) * np.eye(3)
        index = graph.add_constraint(CLOSURE, 0, i, measured[i], information, closure_row=7 * i)
        assert index == i
    assert (graph.num_submaps, graph.num_nodes, graph.num_constraints) == (1, 200, 200)
    np.testing.assert_array_equal(graph.node_poses, poses)
    np.testing.assert_array_equal(graph.relative_poses, measured)
    np.testing.assert_array_equal(graph.informations[:, 1, 1], np.arange(1.0, 201.0))
    np.testing.assert_array_equal(graph.closure_rows, 7 * np.arange(200))


def test_constraints_added_at_once_equal_those_added_one_by_one():
    one_by_one, at_once = small_graph(), small_graph()
    measured = np.arange(6.0).reshape(2, 3)
    for node in range(2):
        one_by_one.add_constraint(INTRA, 0, node, measured[node], np.eye(3))
    assert (
        at_once.add_constraints(INTRA, [0, 0], [0, 1], measured, np.tile(np.eye(3), (2, 1, 1))) == 0
    )
    for name in ("kinds", "index_a", "index_b", "relative_poses", "informations", "closure_rows"):
        np.testing.assert_array_equal(getattr(one_by_one, name), getattr(at_once, name))


def test_only_loop_closures_have_a_row_in_the_record():
    graph = small_graph()
    graph.add_constraint(INTRA, 0, 1, (0, 0, 0), np.eye(3))
    assert graph.closure_rows.tolist() == [-1]


def closures(*rows):
    count = len(rows)
    return ClosureConstraints(
        np.array(rows),
        np.zeros(count, np.int64),
        np.ones(count, np.int64),
        np.tile(rows, (3, 1)).T.astype(float),
        np.tile(np.eye(3), (count, 1, 1)),
    )


def test_loop_closures_are_replaced_in_place():
    graph = small_graph()
    graph.add_loop_closures(closures(4, 5))
    graph.add_constraint(INTRA, 0, 1, (9, 9, 0), np.eye(3))
    before = graph.copy()

    graph.replace_loop_closures([closures(7), closures(8, 9)])

    assert graph.closure_rows.tolist() == [-1, 7, 8, 9]
    assert graph.relative_poses[:, 0].tolist() == [9.0, 7.0, 8.0, 9.0]
    assert (graph.num_loop_closures, graph.revision) == (3, 1)
    assert (before.closure_rows.tolist(), before.revision) == ([4, 5, -1], 0)


def test_a_replacement_that_fails_changes_nothing():
    graph = small_graph()
    graph.add_loop_closures(closures(4, 5))

    with pytest.raises(IndexError):
        graph.replace_loop_closures([closures(7), closures(8)._replace(node=np.array([99]))])

    assert graph.closure_rows.tolist() == [4, 5]
    assert graph.revision == 0


def test_constraints_are_removed_in_place():
    graph = small_graph()
    graph.add_loop_closures(closures(4, 5, 6))

    graph.remove(np.array([False, True, False]))

    assert graph.closure_rows.tolist() == [4, 6]
    assert (graph.num_loop_closures, graph.revision) == (2, 1)


def test_fixing_a_vertex_twice_names_it_once():
    graph = small_graph()
    for _ in range(2):
        graph.fix_node(1)
        graph.fix_submap(0)
    assert graph.fixed_nodes == (1,)
    assert graph.fixed_submaps == (0,)


@pytest.mark.parametrize(
    ("kind", "a", "b"), [(INTRA, 1, 0), (INTRA, 0, 2), (INTRA, -1, 0), (BETWEEN_NODES, 2, 0)]
)
def test_a_constraint_to_a_vertex_that_is_not_there_is_refused(kind, a, b):
    graph = small_graph()
    with pytest.raises(IndexError, match="first"):
        graph.add_constraint(kind, a, b, (0, 0, 0), np.eye(3))
    assert graph.num_constraints == 0


@pytest.mark.parametrize(
    ("pose", "information", "message"),
    [
        ((np.nan, 0, 0), np.eye(3), "not finite"),
        ((0, 0, 0), np.diag([1.0, np.inf, 1.0]), "not finite"),
        ((0, 0, 0), np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]), "not symmetric"),
        ((0, 0, 0), np.diag([1.0, -1.0, 1.0]), "negative diagonal"),
    ],
)
def test_impossible_measurements_are_refused(pose, information, message):
    graph = small_graph()
    with pytest.raises(ValueError, match=message):
        graph.add_constraint(INTRA, 0, 1, pose, information)
    assert graph.num_constraints == 0


@pytest.mark.parametrize("short", [1, 2, 3])
def test_columns_of_constraints_must_be_of_one_length(short):
    graph = small_graph()
    columns = [[0, 0], [0, 1], np.zeros((2, 3)), [np.eye(3)] * 2]
    columns[short] = columns[short][:1]
    with pytest.raises(ValueError, match="not of one length"):
        graph.add_constraints(INTRA, *columns)
    assert graph.num_constraints == 0


def test_a_node_cannot_be_constrained_to_itself():
    with pytest.raises(ValueError, match="itself"):
        small_graph().add_constraint(BETWEEN_NODES, 1, 1, (0, 0, 0), np.eye(3))


@pytest.mark.parametrize("vertex", [-1, 5])
def test_only_vertices_of_the_graph_can_be_fixed(vertex):
    with pytest.raises(IndexError, match="not in the graph"):
        small_graph().fix_node(vertex)
    with pytest.raises(IndexError, match="not in the graph"):
        small_graph().fix_submap(vertex)
