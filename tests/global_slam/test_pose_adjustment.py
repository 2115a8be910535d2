# SPDX-License-Identifier: Apache-2.0
"""Sparse pose adjustment (eq. SPA): optimal, robust, reproducible, for any graph."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.adjustment.grid_world import grid_world
from cartoloop.global_slam.pose_adjustment import (
    AdjustmentOptions,
    PoseAdjuster,
    adjust,
    chain_share,
    constraint_residuals,
    graph_problem,
)
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.kernels.pose_adjustment.losses import DECIDED
from cartoloop.pose_adjustment import (
    GroupLoss,
    Loss,
    cost_at,
    kernel_losses,
    linearise,
    plan,
)
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles
from tests.global_slam.bipartite_graph import all_poses, walk
from tests.reference import naive_pose_adjustment as naive

M_ESTIMATORS = [loss for loss in Loss if loss not in DECIDED]
SKEWED = np.array([[900.0, 200.0, 50.0], [200.0, 300.0, -80.0], [50.0, -80.0, 2000.0]])
EXACT = {"noise": (0.0, 0.0), "drift": (0.3, 0.05)}

seeds = st.integers(0, 2**32 - 1)


def to_the_end(loss=Loss.HUBER, **options):
    return AdjustmentOptions(loss=loss, relative_tolerance=1e-12, max_iterations=200, **options)


def system_poses(graph):
    """Return the poses of all vertices as the solver has them, the map frame last."""
    return graph_problem(graph).poses()


def position_errors(graph, expected):
    return np.hypot(*(graph.node_poses - expected)[:, :2].T)


@given(seeds, st.sampled_from(M_ESTIMATORS), st.integers(0, 2), st.integers(0, 6), st.booleans())
@settings(deadline=None, max_examples=8)
def test_the_result_is_that_of_a_slow_dense_solver(seed, loss, num_false, num_odometry, skewed):
    information = SKEWED if skewed else np.diag([500.0, 500.0, 1600.0])
    graph = walk(
        12,
        3,
        6,
        seed=seed,
        num_false=num_false,
        num_odometry=num_odometry,
        information=information,
    ).graph
    poses, cost = naive.adjust(graph, {0}, loss, loss.default_scale)
    before = naive.cost(graph, all_poses(graph), loss, loss.default_scale)
    result = adjust(graph, to_the_end(loss))
    assert result.initial_cost == pytest.approx(before, rel=1e-9)
    assert result.cost == pytest.approx(
        naive.cost(graph, all_poses(graph), loss, loss.default_scale), rel=1e-9
    )
    if loss in (Loss.NONE, Loss.HUBER):  # the others may rest in different local minima
        assert result.cost <= cost * (1.0 + 1e-6) + 1e-9
    if abs(result.cost - cost) <= 1e-9 * cost:
        difference = all_poses(graph) - poses
        difference[:, 2] = wrap_angles(difference[:, 2])
        np.testing.assert_allclose(difference, 0.0, atol=1e-4)


@given(seeds, st.integers(0, 8))
@settings(deadline=None, max_examples=25)
def test_one_step_is_that_of_the_dense_normal_equations(seed, num_odometry):
    graph = walk(15, 4, 10, seed=seed, num_odometry=num_odometry, information=SKEWED).graph
    poses, m = all_poses(graph), graph.num_submaps
    least_squares = kernel_losses([GroupLoss()] * len(ConstraintKind))
    system = linearise(plan(graph_problem(graph)), system_poses(graph), least_squares, 0.0)
    step = system.step()
    stepped = system_poses(graph)
    step.move(stepped)
    np.testing.assert_array_equal(stepped[-1], 0.0)
    stepped = stepped[:-1]

    hessian, gradient = np.zeros((poses.size, poses.size)), np.zeros(poses.size)
    for i in range(graph.num_constraints):
        a = graph.index_a[i] + (m if graph.kinds[i] == ConstraintKind.NODE_TO_NODE else 0)
        b = m + graph.index_b[i]
        jacobian = np.zeros((3, poses.size))
        measured = graph.relative_poses[i]
        jacobian[:, 3 * a : 3 * a + 3], jacobian[:, 3 * b : 3 * b + 3] = naive.residual_jacobians(
            poses[a], poses[b], measured
        )
        hessian += jacobian.T @ graph.informations[i] @ jacobian
        gradient += (
            jacobian.T @ graph.informations[i] @ naive.residual(poses[a], poses[b], measured)
        )
    expected = np.linalg.solve(hessian[3:, 3:], -gradient[3:])
    np.testing.assert_allclose((stepped - poses).ravel()[3:], expected, rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(stepped[0], poses[0])
    assert step.decrease == pytest.approx(-0.5 * gradient[3:] @ expected, rel=1e-5)
    assert system.cost == pytest.approx(naive.cost(graph, poses), rel=1e-9)


@pytest.mark.parametrize("num_odometry", [0, 30])
@pytest.mark.parametrize("loss", list(Loss))
def test_a_consistent_graph_that_was_perturbed_is_recovered(loss, num_odometry):
    graph, submaps, nodes = walk(120, 8, 60, **EXACT, seed=4)
    rng = np.random.default_rng(1)
    graph.node_poses[:] += rng.normal(0.0, (0.2, 0.2, 0.05), graph.node_poses.shape)
    result = adjust(graph, to_the_end(loss))
    assert result.converged
    assert result.cost < 1e-12
    np.testing.assert_allclose(graph.submap_poses[:, :2], submaps[:, :2], atol=1e-6)
    np.testing.assert_allclose(graph.node_poses[:, :2], nodes[:, :2], atol=1e-6)
    np.testing.assert_allclose(wrap_angles(graph.node_poses[:, 2] - nodes[:, 2]), 0.0, atol=1e-6)


def test_the_default_tolerance_is_a_millionth_of_the_cost():
    for seed in range(5):
        quick, exact = (walk(600, 30, 400, seed=seed).graph for _ in range(2))
        result = adjust(quick)
        assert result.converged
        assert result.cost <= adjust(exact, to_the_end()).cost * (1.0 + 1e-6)


@pytest.mark.parametrize("loss", list(Loss))
def test_the_same_graph_gives_the_same_bytes(loss):
    outcomes = []
    for _ in range(2):
        graph = walk(200, 10, 60, seed=2, num_false=8, num_odometry=50).graph
        result = adjust(graph, AdjustmentOptions(loss=loss))
        outcomes.append((all_poses(graph).tobytes(), result.weights.tobytes(), result.cost))
    assert outcomes[0] == outcomes[1]


def test_a_second_adjustment_finds_nothing_to_do():
    graph = walk(200, 10, 60, seed=2).graph
    first = adjust(graph, to_the_end())
    poses = all_poses(graph)
    second = adjust(graph, AdjustmentOptions(Loss.HUBER))
    assert second.iterations <= 1
    assert second.cost == pytest.approx(first.cost, rel=1e-9)
    np.testing.assert_allclose(all_poses(graph), poses, atol=1e-7)


@pytest.mark.parametrize("loss", [loss for loss in Loss if loss is not Loss.NONE])
def test_robust_losses_reduce_the_effect_of_false_closures(loss):
    def error_with(chosen):
        graph, _, nodes = walk(300, 15, 60, seed=5, num_false=12)
        result = adjust(graph, to_the_end(chosen))
        return position_errors(graph, nodes).mean(), result, graph

    bent, _, _ = error_with(Loss.NONE)
    error, result, graph = error_with(loss)
    # the influence of a false closure never vanishes with Huber's loss
    assert error < (0.8 if loss is Loss.HUBER else 0.2) * bent
    closures = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    assert result.weights[closures[:12]].max() < result.weights[closures[12:]].min()
    np.testing.assert_array_equal(result.weights[graph.kinds == ConstraintKind.INTRA_SUBMAP], 1.0)


@pytest.mark.parametrize("loss", sorted(DECIDED))
def test_false_closures_are_out_true_ones_are_in(loss):
    graph, _, nodes = walk(300, 15, 60, seed=5, num_false=12)
    result = adjust(graph, to_the_end(loss))
    closures = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    np.testing.assert_array_equal(result.weights[closures[:12]], 0.0)
    np.testing.assert_array_equal(result.weights[closures[12:]], 1.0)
    assert result.cost == pytest.approx(
        naive.cost(graph, all_poses(graph), loss, loss.default_scale), rel=1e-9
    )
    assert position_errors(graph, nodes).mean() < 0.1


@pytest.mark.parametrize("loss", sorted(DECIDED))
def test_false_closures_that_agree_are_separated_once(loss):
    graph, _, nodes = walk(300, 15, 60, seed=5)
    adjuster = PoseAdjuster(graph)
    options = to_the_end(loss)
    adjuster.adjust(options)
    false = np.arange(60, 76)
    wrong = compose_all(
        np.array((1.5, -1.0, 0.3)), relative_all(graph.submap_poses[9], nodes[false])
    )
    graph.add_constraints(
        ConstraintKind.LOOP_CLOSURE,
        np.full(false.size, 9),
        false,
        wrong,
        np.tile(np.diag((500.0, 500.0, 1600.0)), (false.size, 1, 1)),
    )
    deciding = adjuster.adjust(options)
    np.testing.assert_array_equal(deciding.weights[-false.size :], 0.0)
    assert position_errors(graph, nodes).mean() < 0.1
    # the decision stands, so that it is not taken again
    standing = adjuster.adjust(options)
    np.testing.assert_array_equal(standing.weights, deciding.weights)
    assert standing.iterations <= 3 < deciding.iterations


def stiff_chain(num_closures):
    """Return a straight chain 0.7 m too long, for as many springs too stiff, and as many closures.

    Huber's force does not close it; least squares does, at less cost than leaving them out.
    """
    graph, links = PoseGraph(), 5
    places = np.zeros((links + 1, 3))
    places[:, 0] = 1.14 * np.arange(links + 1)
    graph.add_submaps(places)
    graph.add_nodes(places)
    stiff = 2800.0 * num_closures * np.eye(3)
    for k in range(links + 1):
        graph.add_constraint(ConstraintKind.INTRA_SUBMAP, k, k, np.zeros(3), stiff)
    for k in range(links):
        graph.add_constraint(
            ConstraintKind.INTRA_SUBMAP, k, k + 1, np.array((1.14, 0.0, 0.0)), stiff
        )
    for _ in range(num_closures):
        graph.add_constraint(
            ConstraintKind.LOOP_CLOSURE, 0, links, np.array((5.0, 0.0, 0.0)), 500.0 * np.eye(3)
        )
    return graph


@pytest.mark.parametrize(("num_closures", "weight"), [(4, 1.0), (1, 0.0)])
def test_several_closures_bend_a_chain_a_single_one_does_not(num_closures, weight):
    graph = stiff_chain(num_closures)
    found = adjust(graph, to_the_end(Loss.TRUNCATED))
    closures = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    np.testing.assert_array_equal(found.weights[closures], weight)
    assert (graph.node_poses[-1, 0] < 5.4) == (weight == 1.0)


def test_a_chain_of_which_a_share_counts_bends_to_one_closure():
    graph = stiff_chain(1)
    found = adjust(graph, to_the_end(Loss.TRUNCATED, chain_share=0.01))
    assert found.weights[graph.kinds == ConstraintKind.LOOP_CLOSURE].tolist() == [1.0]
    np.testing.assert_array_equal(graph.informations, stiff_chain(1).informations)


def closure_weights(graph, **options):
    found = adjust(graph, to_the_end(Loss.TRUNCATED, **options))
    return found.weights[graph.kinds == ConstraintKind.LOOP_CLOSURE].tolist()


def several_closures(count):
    """A chain that is too stiff for closures which agree."""
    graph = stiff_chain(1)
    for _ in range(count - 1):
        graph.add_constraint(
            ConstraintKind.LOOP_CLOSURE, 0, 5, np.array((5.0, 0.0, 0.0)), 500.0 * np.eye(3)
        )
    graph.informations[graph.kinds == ConstraintKind.INTRA_SUBMAP] *= 8.0
    return graph


def test_closures_that_agree_with_a_flexible_chain_are_kept():
    """The poses are least squares of the chain as it is."""
    graph, least_squares = several_closures(3), several_closures(3)
    assert closure_weights(several_closures(3)) == [0.0, 0.0, 0.0]
    assert closure_weights(graph, flexible_share=0.01) == [1.0, 1.0, 1.0]
    adjust(least_squares, to_the_end(Loss.NONE))
    np.testing.assert_allclose(graph.node_poses, least_squares.node_poses, atol=1e-6)


def test_closures_kept_with_a_share_of_the_chain_hold():
    """The poses are least squares of the chain as it is."""
    graph, least_squares = stiff_chain(1), stiff_chain(1)
    assert closure_weights(graph, decision_share=0.01) == [1.0]
    adjust(least_squares, to_the_end(Loss.NONE))
    np.testing.assert_allclose(graph.node_poses, least_squares.node_poses, atol=1e-6)


def test_two_closures_do_not_bend_a_stiff_chain():
    assert closure_weights(several_closures(2), flexible_share=0.01) == [0.0, 0.0]


def test_closures_of_which_one_disagrees_do_not_bend_it():
    graph, straight = several_closures(3), several_closures(3)
    for made in (graph, straight):
        far = np.array((500.0, 0.0, 0.0))
        made.add_constraint(ConstraintKind.LOOP_CLOSURE, 0, 5, far, 500.0 * np.eye(3))
    assert closure_weights(graph, flexible_share=0.01) == [0.0, 0.0, 0.0, 0.0]
    assert closure_weights(straight) == [0.0, 0.0, 0.0, 0.0]
    np.testing.assert_array_equal(graph.node_poses, straight.node_poses)


def test_a_chain_counts_in_full_unless_closures_bend_it():
    straight = stiff_chain(4)
    assert chain_share(straight, 4.0) == 1.0
    bent = stiff_chain(4)
    adjust(bent, to_the_end(Loss.NONE))
    is_chain = np.flatnonzero(bent.kinds == ConstraintKind.INTRA_SUBMAP)
    apart, turned = constraint_residuals(bent, is_chain)
    chi_square = 2800.0 * 4 * float((apart**2 + turned**2).sum())
    assert chi_square > 4.0
    # Eleven constraints between twelve poses leave no freedom; two more rows leave three each.
    assert chain_share(bent, 4.0) == 1.0
    for k in range(2):
        bent.add_constraint(ConstraintKind.INTRA_SUBMAP, k, k, np.zeros(3), np.zeros((3, 3)))
    assert chain_share(bent, 4.0) == pytest.approx(4.0 / (chi_square / 6.0))


@pytest.mark.parametrize("loss", [Loss.NONE, Loss.HUBER, *sorted(DECIDED)])
def test_a_chain_that_turned_by_radians_is_adjusted(loss):
    graph, truth = grid_world(600, seed=2, noise=(0.05, 0.2))
    graph_at_truth = graph.copy()
    graph_at_truth.node_poses[:] = truth
    kinds = (ConstraintKind.NODE_TO_NODE,)
    options = AdjustmentOptions(loss, robust_kinds=kinds, max_iterations=100)
    assert position_errors(graph, truth).mean() > 3.0
    result = adjust(graph, options)
    assert result.converged
    assert result.cost == pytest.approx(adjust(graph_at_truth, options).cost, rel=1e-3)


def test_the_loss_acts_on_the_robust_kinds_alone():
    graph = walk(60, 6, 20, seed=1, num_false=4).graph
    result = adjust(graph, AdjustmentOptions(robust_kinds=()))
    np.testing.assert_array_equal(result.weights, 1.0)


def test_the_first_submap_stays_unless_others_are_fixed():
    graph = walk(60, 6, 20, seed=1).graph
    first = graph.submap_poses[0].copy()
    adjust(graph)
    np.testing.assert_array_equal(graph.submap_poses[0], first)

    graph = walk(60, 6, 20, seed=1).graph
    graph.fix_submap(3)
    graph.fix_node(50)
    before = graph.submap_poses.copy(), graph.node_poses.copy()
    adjust(graph)
    np.testing.assert_array_equal(graph.submap_poses[3], before[0][3])
    np.testing.assert_array_equal(graph.node_poses[50], before[1][50])
    assert not np.array_equal(graph.submap_poses[0], before[0][0])


def test_moving_the_gauge_moves_the_whole_map_with_it():
    tf_new_old = np.array([3.0, -7.0, 2.0])
    here, there = (walk(100, 8, 40, seed=6, num_odometry=20).graph for _ in range(2))
    there.submap_poses[:] = compose_all(tf_new_old, there.submap_poses)
    there.node_poses[:] = compose_all(tf_new_old, there.node_poses)
    assert adjust(here, to_the_end()).cost == pytest.approx(adjust(there, to_the_end()).cost)
    moved = compose_all(tf_new_old, all_poses(here))
    difference = all_poses(there) - moved
    difference[:, 2] = wrap_angles(difference[:, 2])
    np.testing.assert_allclose(difference, 0.0, atol=1e-6)


def test_the_order_of_constraints_does_not_matter():
    graph = walk(100, 8, 40, seed=3, num_false=4, num_odometry=20).graph
    shuffled = PoseGraph()
    shuffled.add_submaps(graph.submap_poses)
    shuffled.add_nodes(graph.node_poses)
    order = np.random.default_rng(0).permutation(graph.num_constraints)
    shuffled.add_constraints(
        graph.kinds[order],
        graph.index_a[order],
        graph.index_b[order],
        graph.relative_poses[order],
        graph.informations[order],
    )
    result, other = adjust(graph, to_the_end()), adjust(shuffled, to_the_end())
    np.testing.assert_allclose(other.weights, result.weights[order], rtol=1e-5)
    np.testing.assert_allclose(all_poses(shuffled), all_poses(graph), atol=1e-6)


def test_an_empty_graph_is_left_alone():
    result = adjust(PoseGraph())
    assert result.converged
    assert (result.cost, result.iterations, result.weights.size) == (0.0, 0, 0)


def test_without_constraints_nothing_moves():
    graph = PoseGraph()
    graph.add_submaps(np.ones((2, 3)))
    graph.add_nodes(np.full((3, 3), 2.0))
    before = all_poses(graph)
    assert adjust(graph).converged
    np.testing.assert_array_equal(all_poses(graph), before)


@pytest.mark.parametrize("loss", list(Loss))
def test_nodes_of_one_submap_move_to_where_they_were_seen(loss):
    graph = PoseGraph()
    graph.add_submap((1.0, 2.0, 0.5))
    graph.add_nodes(np.zeros((3, 3)))
    seen = np.array([[1.0, 0.0, 0.1], [2.0, 0.0, 0.2], [3.0, 1.0, -3.0]])
    graph.add_constraints(
        ConstraintKind.INTRA_SUBMAP, [0, 0, 0], [0, 1, 2], seen, np.tile(SKEWED, (3, 1, 1))
    )
    assert adjust(graph, to_the_end(loss)).converged
    expected = compose_all(graph.submap_poses[0], seen)
    np.testing.assert_allclose(graph.node_poses, expected, atol=1e-8)


def test_separate_parts_are_held_at_their_first_submap():
    left, right = walk(40, 4, 15, seed=1), walk(40, 4, 15, seed=2)
    graph = PoseGraph()
    for part in (left.graph, right.graph):
        first_submap, first_node = graph.num_submaps, graph.num_nodes
        graph.add_submaps(part.submap_poses)
        graph.add_nodes(part.node_poses)
        graph.add_constraints(
            part.kinds,
            part.index_a + first_submap,
            part.index_b + first_node,
            part.relative_poses,
            part.informations,
        )
    lonely = graph.add_node((9.0, 9.0, 1.0))
    expected = adjust(left.graph, to_the_end()).cost + adjust(right.graph, to_the_end()).cost
    result = adjust(graph, to_the_end())
    assert result.cost == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(graph.node_poses[:40], left.graph.node_poses, atol=1e-7)
    np.testing.assert_allclose(graph.node_poses[40:80], right.graph.node_poses, atol=1e-7)
    np.testing.assert_array_equal(graph.node_poses[lonely], (9.0, 9.0, 1.0))


@pytest.mark.parametrize("unknown", [0, 2])
def test_a_direction_that_nothing_measures_does_not_move(unknown):
    information = np.diag([500.0, 500.0, 1600.0])
    information[unknown, unknown] = 0.0
    graph = PoseGraph()
    graph.add_submaps(np.zeros((2, 3)))
    graph.add_nodes(np.zeros((2, 3)))
    graph.add_constraints(
        ConstraintKind.INTRA_SUBMAP,
        [0, 0, 1],
        [0, 1, 1],
        np.tile([1.0, 2.0, 0.0], (3, 1)),
        np.tile(information, (3, 1, 1)),
    )
    result = adjust(graph)
    assert np.isfinite(all_poses(graph)).all()
    assert result.cost < 1e-9
    assert np.abs(graph.node_poses[:, unknown]).max() < 1e-6


def test_one_submap_that_saw_a_node_twice_counts_both():
    graph = PoseGraph()
    graph.add_submaps([(0.0, 0.0, 0.0), (1.0, 1.0, 0.3)])
    graph.add_node((0.5, 0.5, 0.0))
    seen = [(1.0, 0.0, 0.1), (0.5, 0.5, 0.1), (0.7, 0.5, 0.3), (0.2, 0.1, -0.2)]
    graph.add_constraints(
        ConstraintKind.INTRA_SUBMAP, [1, 0, 1, 0], [0, 0, 0, 0], seen, np.tile(SKEWED, (4, 1, 1))
    )
    _, cost = naive.adjust(graph, {0})
    assert adjust(graph, to_the_end()).cost == pytest.approx(cost, rel=1e-9)


def test_too_few_iterations_are_reported():
    graph = walk(200, 10, 60, seed=2, drift=(0.3, 0.05)).graph
    result = adjust(graph, AdjustmentOptions(Loss.HUBER, max_iterations=1))
    assert not result.converged
    assert result.iterations == 1
    assert result.cost < result.initial_cost


def test_residuals_are_how_much_constraints_are_violated():
    graph = PoseGraph()
    graph.add_submap((1.0, 0.0, np.pi / 2.0))
    graph.add_nodes([(1.0, 2.0, np.pi), (1.0, 3.0, -np.pi)])
    graph.add_constraint(ConstraintKind.LOOP_CLOSURE, 0, 0, (2.3, 0.4, 1.5), np.eye(3))
    graph.add_constraint(ConstraintKind.NODE_TO_NODE, 0, 1, (0.0, -1.0, 0.25), np.eye(3))
    translation, rotation = constraint_residuals(graph)
    np.testing.assert_allclose(translation, (0.5, 0.0), atol=1e-12)
    np.testing.assert_allclose(rotation, (np.pi / 2.0 - 1.5, 0.25), atol=1e-12)
    for none in constraint_residuals(PoseGraph()):
        assert none.size == 0


def test_residuals_of_a_graph_without_submaps():
    graph = PoseGraph()
    graph.add_nodes([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    graph.add_constraint(ConstraintKind.NODE_TO_NODE, 0, 1, (1.5, 0.0, 0.0), np.eye(3))
    np.testing.assert_allclose(constraint_residuals(graph)[0], 0.5)


def test_a_step_after_another_linearisation_is_refused():
    graph = walk(15, 4, 10).graph
    planned, losses = plan(graph_problem(graph)), kernel_losses([GroupLoss()] * 3)
    system = linearise(planned, system_poses(graph), losses, 0.0)
    step = system.step()
    cost_at(planned, system_poses(graph), losses)
    with pytest.raises(RuntimeError, match="linearise again"):
        system.step()
    with pytest.raises(RuntimeError, match="linearise again"):
        step.move(system_poses(graph))


def test_the_cost_is_whole_where_a_node_cannot_be_eliminated():
    graph = walk(600, 8, 30, seed=3).graph
    graph.add_node((0.0, 0.0, 0.0))
    graph.add_constraint(
        ConstraintKind.INTRA_SUBMAP, 0, 600, (1.0, 0.0, 0.0), np.diag((1.0, 0.0, 0.0))
    )
    planned = plan(graph_problem(graph))
    losses = kernel_losses([GroupLoss()] * 3)
    system = linearise(planned, system_poses(graph), losses, 0.0)
    assert system.step() is None
    assert system.cost == cost_at(planned, system_poses(graph), losses)
    expected = adjust(walk(600, 8, 30, seed=3).graph, to_the_end()).cost
    assert adjust(graph, to_the_end()).cost == pytest.approx(expected, rel=1e-6)
