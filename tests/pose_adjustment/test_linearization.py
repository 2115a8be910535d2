# SPDX-License-Identifier: Apache-2.0
"""Residual, loss and linearisation of constraints against eq. (4), (5) and finite differences."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.pose_adjustment.layout import LANES
from cartoloop.kernels.pose_adjustment.losses import FIXED_WEIGHTS
from cartoloop.kernels.pose_adjustment.robust_loss import robust_loss
from cartoloop.pose_adjustment import (
    Constraints,
    GroupLoss,
    Loss,
    Problem,
    cost_at,
    kernel_losses,
    plan,
    residuals,
)
from tests.reference import naive_pose_adjustment as naive

NUM = 11  # constraints of a test: two rows, the second with lanes to spare
UPPER = np.triu_indices(3)

seeds = st.integers(0, 2**32 - 1)
losses = st.sampled_from(list(Loss))


def random_links(seed, spread=1.0):
    """Return the problem of links between random nodes."""
    rng = np.random.default_rng(seed)
    poses = rng.normal(0.0, (5.0, 5.0, 3.0), (2 * NUM, 3))
    half = rng.normal(size=(NUM, 3, 3)) * (3.0, 3.0, 5.0)
    measured = [
        rng.normal(0.0, spread * np.array([0.3, 0.3, 0.1]))
        - naive.residual(poses[2 * i], poses[2 * i + 1], np.zeros(3))
        for i in range(NUM)
    ]
    links = Constraints(
        np.zeros(NUM, dtype=np.int64),
        np.ones(NUM, dtype=bool),
        np.arange(0, 2 * NUM, 2),
        np.arange(1, 2 * NUM, 2),
        np.array(measured),
        half @ half.transpose(0, 2, 1),
    )
    return Problem(np.zeros((0, 3)), poses, links)


def linearised(problem, loss=Loss.NONE, scale=1.0):
    """Return the cost, and of each constraint d, b, A and the weight of its model."""
    planned = plan(problem)
    cost = cost_at(planned, problem.poses(), kernel_losses([GroupLoss(loss, scale)]))
    models = []
    for e in range(NUM):
        column = planned.direct.linear[e // LANES].reshape(12, LANES)[:, e % LANES]
        upper = np.zeros((3, 3))
        upper[UPPER] = column[5:11]
        models.append((column[:2], column[2:5], upper + np.triu(upper, 1).T))
    return cost, models, planned.weights()


def ends(problem, e):
    """Return the poses of a and b of a constraint, what was measured, and its information."""
    c = problem.constraints
    return *problem.node_poses[[2 * e, 2 * e + 1]], c.tf_a_b[e], c.informations[e]


def motion_of_b_with_a(d):
    return np.array([[1.0, 0.0, -d[1]], [0.0, 1.0, d[0]], [0.0, 0.0, 1.0]])


@given(seeds)
@settings(deadline=None)  # the first example compiles
def test_squared_residual_is_that_of_the_paper(seed):
    problem = random_links(seed)
    measured = residuals(problem)
    for i in range(NUM):
        *pose, relative, information = ends(problem, i)
        e = naive.residual(*pose, relative)
        assert measured.squared[i] == pytest.approx(e @ information @ e, rel=1e-9, abs=1e-9)
        assert measured.translation[i] == pytest.approx(math.hypot(*e[:2]), abs=1e-12)
        assert measured.rotation[i] == pytest.approx(abs(e[2]), abs=1e-12)


@given(seeds)
@settings(deadline=None)  # the first example compiles
def test_full_turns_change_nothing(seed):
    problem = random_links(seed)
    cost = linearised(problem)[0]
    problem.node_poses[1::2, 2] += 2.0 * math.tau
    problem.constraints.tf_a_b[:, 2] -= math.tau
    assert linearised(problem)[0] == pytest.approx(cost, rel=1e-9, abs=1e-9)


@given(seeds, losses)
@settings(deadline=None)  # the first example compiles
def test_the_gradient_is_that_of_finite_differences(seed, loss):
    problem, scale = random_links(seed), 2.0
    total, models, weights = linearised(problem, loss, scale)
    expected = 0.0
    for i in range(NUM):
        pose_a, pose_b, relative, information = ends(problem, i)
        d, b, _ = models[i]

        def cost_at_poses(moved, relative=relative, information=information):
            e = naive.residual(*moved.reshape(2, 3), relative)
            return 0.5 * naive.rho(loss, scale, e @ information @ e)

        poses = np.concatenate((pose_a, pose_b))
        expected += cost_at_poses(poses)
        e = naive.residual(pose_a, pose_b, relative)
        assert 0.0 <= weights[i] <= 1.0
        if abs(e @ information @ e - scale**2) < 1e-2 * (1.0 + scale**2):
            continue  # where some losses have a kink
        step = 1e-6
        numeric = [
            (cost_at_poses(poses + step * unit) - cost_at_poses(poses - step * unit)) / (2.0 * step)
            for unit in np.eye(6)
        ]
        gradient = np.concatenate((motion_of_b_with_a(d).T @ b, -b))
        tolerance = 1e-4 * (1.0 + cost_at_poses(poses))
        np.testing.assert_allclose(gradient, numeric, rtol=1e-4, atol=tolerance)
    assert total == pytest.approx(expected, rel=1e-9, abs=1e-12)


@given(seeds)
@settings(deadline=None)  # the first example compiles
def test_the_hessian_is_that_of_numeric_jacobians(seed):
    problem = random_links(seed)
    _, models, _ = linearised(problem)
    for i in range(NUM):
        pose_a, pose_b, relative, information = ends(problem, i)
        d, _, matrix = models[i]
        by_a, by_b = naive.residual_jacobians(pose_a, pose_b, relative)
        t = motion_of_b_with_a(d)
        size = np.abs(t.T @ matrix @ t).max() + np.abs(matrix).max()
        for ours, first, second in (
            (matrix, by_b, by_b),
            (-matrix @ t, by_b, by_a),
            (t.T @ matrix @ t, by_a, by_a),
        ):
            np.testing.assert_allclose(ours, first.T @ information @ second, atol=1e-6 * size)


@given(losses, st.floats(0.1, 20.0), st.floats(0.0, 1e4))
@settings(deadline=None)  # the first example compiles
def test_a_loss_is_its_formula_the_weight_its_derivative(loss, scale, squared):
    rho, weight = robust_loss(loss.code, scale, squared)
    assert rho == pytest.approx(naive.rho(loss, scale, squared), rel=1e-9, abs=1e-12)
    assert 0.0 <= weight <= 1.0
    step = 1e-5 * (scale**2 + squared)
    if squared > step and abs(squared - scale**2) > 2.0 * step:
        higher = naive.rho(loss, scale, squared + step)
        lower = naive.rho(loss, scale, squared - step)
        assert weight == pytest.approx((higher - lower) / (2.0 * step), rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("loss", list(Loss))
def test_every_loss_is_concave_in_the_squared_residual(loss):
    for scale in (0.5, loss.default_scale, 20.0):
        squared = np.concatenate(([0.0], np.geomspace(1e-6, 1e6, 2000))) * scale**2
        rho, weight = np.array([robust_loss(loss.code, scale, s) for s in squared]).T
        assert np.all(np.diff(weight) <= 1e-12)
        # nowhere above a tangent: then steps of the weighted model never raise the cost
        for here in range(0, squared.size, 97):
            tangent = rho[here] + weight[here] * (squared - squared[here])
            assert np.all(rho <= tangent + 1e-9 * (1.0 + squared + squared[here]))


def test_the_table_of_losses_has_codes_in_order_and_scales():
    assert [loss.code for loss in Loss] == list(range(len(Loss)))
    assert len(Loss) == FIXED_WEIGHTS
    assert all(loss.default_scale > 0.0 for loss in Loss)
    assert Loss("huber").default_scale == 3.0
