# SPDX-License-Identifier: Apache-2.0
"""How certain a match is taken to be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.scan_matching.least_squares import (
    MIN_RESIDUAL,
    MIN_SIGMA_M,
    MIN_SIGMA_RAD,
    LeastSquaresMatch,
    match_information,
)


def information(curvature, residual=0.3):
    fields = dict.fromkeys(LeastSquaresMatch._fields, 0.0)
    fields["information"] = np.array(curvature, dtype=np.float64)
    fields["residual"] = residual
    return match_information(LeastSquaresMatch(**fields))


def random_curvature(seed, scale):
    factor = np.random.default_rng(seed).normal(size=(4, 3)) * scale
    return factor.T @ factor


@settings(deadline=None, max_examples=80)
@given(
    seed=st.integers(0, 2**32 - 1),
    scale=st.floats(1e-2, 1e4),
    residual=st.floats(0.0, 0.9),
)
def test_information_is_symmetric_positive_and_bounded(seed, scale, residual):
    found = information(random_curvature(seed, scale), residual)
    assert np.array_equal(found, found.T)
    assert np.linalg.eigvalsh(found).min() > 0.0
    sigmas = np.sqrt(np.diag(np.linalg.inv(found)))
    assert (sigmas >= np.array((MIN_SIGMA_M, MIN_SIGMA_M, MIN_SIGMA_RAD)) * (1 - 1e-6)).all()


def test_covariance_is_that_of_the_fit_plus_a_floor():
    curvature, residual = random_curvature(3, 100.0), 0.4
    floor = np.diag((MIN_SIGMA_M**2, MIN_SIGMA_M**2, MIN_SIGMA_RAD**2))
    expected = residual**2 * np.linalg.inv(curvature) + floor
    covariance = np.linalg.inv(information(curvature, residual))
    assert covariance == pytest.approx(expected, rel=1e-3)


def test_a_worse_fit_is_less_certain():
    curvature = random_curvature(5, 50.0)
    better, worse = information(curvature, 0.2), information(curvature, 0.5)
    assert np.linalg.eigvalsh(better - worse).min() > 0.0


def test_a_fit_too_good_to_be_true_gains_nothing():
    curvature = random_curvature(5, 50.0)
    assert np.array_equal(information(curvature, 0.0), information(curvature, MIN_RESIDUAL))


def test_a_corridor_leaves_its_long_direction_open():
    # Walls along the diagonal: the match knows x - y and the angle, and nothing of x + y.
    across = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    along = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    curvature = 1e5 * np.outer(across, across) + np.diag((0.0, 0.0, 1e4))
    covariance = np.linalg.inv(information(curvature))
    assert np.sqrt(across @ covariance @ across) < 0.02
    assert np.sqrt(along @ covariance @ along) > 1.0


def test_match_without_information_gives_an_invertible_matrix():
    found = information(np.zeros((3, 3)))
    assert np.isfinite(found).all()
    assert (np.diag(np.linalg.inv(found)) >= 1.0).all()
