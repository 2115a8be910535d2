# SPDX-License-Identifier: Apache-2.0
"""Residual, loss and linearisation of a constraint against eq. (4), (5) and finite differences."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.pose_residuals import (
    CAUCHY,
    DYNAMIC_COVARIANCE_SCALING,
    HUBER,
    LINEAR_SIZE,
    NO_LOSS,
    TRUNCATED,
    linearize_constraints,
    robust_loss,
    squared_residuals,
)
from tests.reference import naive_pose_adjustment as naive

NAMES = {
    NO_LOSS: "none",
    HUBER: "huber",
    CAUCHY: "cauchy",
    DYNAMIC_COVARIANCE_SCALING: "dynamic_covariance_scaling",
    TRUNCATED: "truncated",
}
ENDS = np.array([0]), np.array([1])

seeds = st.integers(0, 2**32 - 1)


def random_constraint(seed, spread=1.0):
    """Return poses of a and b, what was measured, and an information matrix."""
    rng = np.random.default_rng(seed)
    poses = rng.normal(0.0, (5.0, 5.0, 3.0), (2, 3))
    half = rng.normal(size=(3, 3)) * (3.0, 3.0, 5.0)
    away = rng.normal(0.0, spread * np.array([0.3, 0.3, 0.1]))
    return poses, away - naive.residual(*poses, np.zeros(3)), half @ half.T


def row_of(measured, information):
    return np.array([[*measured, *information[np.triu_indices(3)]]])


def linearize(poses, measured, information, loss=NO_LOSS, scale=1.0):
    """Return the cost and the parts of the quadratic model: d, b, A, weight."""
    rotations = np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
    linear, weights = np.empty((1, LINEAR_SIZE)), np.empty(1)
    cost = linearize_constraints(
        poses,
        rotations,
        *ENDS,
        row_of(measured, information),
        np.array([loss]),
        scale,
        linear,
        weights,
    )
    upper = np.zeros((3, 3))
    upper[np.triu_indices(3)] = linear[0, 5:]
    return cost, linear[0, :2], linear[0, 2:5], upper + np.triu(upper, 1).T, weights[0]


def motion_of_b_with_a(d):
    return np.array([[1.0, 0.0, -d[1]], [0.0, 1.0, d[0]], [0.0, 0.0, 1.0]])


@given(seeds)
@settings(deadline=None)  # the first example compiles
def test_squared_residual_is_that_of_the_paper(seed):
    poses, measured, information = random_constraint(seed)
    rotations = np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
    squared = np.empty(1)
    squared_residuals(poses, rotations, *ENDS, row_of(measured, information), squared)
    e = naive.residual(*poses, measured)
    assert squared[0] == pytest.approx(e @ information @ e, rel=1e-9, abs=1e-9)


@given(seeds)
@settings(deadline=None)  # the first example compiles
def test_full_turns_change_nothing(seed):
    poses, measured, information = random_constraint(seed)
    cost = linearize(poses, measured, information)[0]
    poses[1, 2] += 2.0 * math.tau
    measured[2] -= math.tau
    assert linearize(poses, measured, information)[0] == pytest.approx(cost, rel=1e-9, abs=1e-9)


@given(seeds, st.sampled_from(sorted(NAMES)))
@settings(deadline=None)  # the first example compiles
def test_the_gradient_is_that_of_the_cost_by_finite_differences(seed, loss):
    poses, measured, information = random_constraint(seed)
    scale = 2.0
    cost, d, pull, _, _ = linearize(poses, measured, information, loss, scale)
    gradient = np.concatenate((motion_of_b_with_a(d).T @ pull, -pull))

    def cost_at(moved):
        e = naive.residual(*moved.reshape(2, 3), measured)
        return 0.5 * naive.rho(NAMES[loss], scale, e @ information @ e)

    assert cost == pytest.approx(cost_at(poses.ravel()), rel=1e-9, abs=1e-12)
    e = naive.residual(*poses, measured)
    if abs(e @ information @ e - scale**2) < 1e-2 * (1.0 + scale**2):
        return  # where some losses have a kink
    step = 1e-6
    numeric = [
        (cost_at(poses.ravel() + step * unit) - cost_at(poses.ravel() - step * unit)) / (2.0 * step)
        for unit in np.eye(6)
    ]
    np.testing.assert_allclose(gradient, numeric, rtol=1e-4, atol=1e-4 * (1.0 + cost))


@given(seeds)
@settings(deadline=None)  # the first example compiles
def test_the_hessian_is_that_of_numeric_jacobians(seed):
    poses, measured, information = random_constraint(seed)
    _, d, _, matrix, _ = linearize(poses, measured, information)
    by_a, by_b = naive.residual_jacobians(*poses, measured)
    t = motion_of_b_with_a(d)
    size = np.abs(t.T @ matrix @ t).max() + np.abs(matrix).max()
    for ours, first, second in (
        (matrix, by_b, by_b),
        (-matrix @ t, by_b, by_a),
        (t.T @ matrix @ t, by_a, by_a),
    ):
        np.testing.assert_allclose(ours, first.T @ information @ second, atol=1e-6 * size)


@given(st.sampled_from(sorted(NAMES)), st.floats(0.1, 20.0), st.floats(0.0, 1e4))
@settings(deadline=None)  # the first example compiles
def test_losses_are_those_of_their_formulas_and_weights_their_derivatives(loss, scale, squared):
    rho, weight = robust_loss(loss, scale, squared)
    assert rho == pytest.approx(naive.rho(NAMES[loss], scale, squared), rel=1e-9, abs=1e-12)
    assert 0.0 <= weight <= 1.0
    step = 1e-5 * (scale**2 + squared)
    if squared > step and abs(squared - scale**2) > 2.0 * step:
        higher = naive.rho(NAMES[loss], scale, squared + step)
        lower = naive.rho(NAMES[loss], scale, squared - step)
        assert weight == pytest.approx((higher - lower) / (2.0 * step), rel=1e-4, abs=1e-6)


@given(seeds, st.sampled_from(sorted(NAMES)))
@settings(deadline=None)  # the first example compiles
def test_the_quadratic_model_is_nowhere_below_the_loss(seed, loss):
    rng = np.random.default_rng(seed)
    here, there = rng.uniform(0.0, 100.0, 2)
    rho, weight = robust_loss(loss, 3.0, here)
    assert robust_loss(loss, 3.0, there)[0] <= rho + weight * (there - here) + 1e-9
