# SPDX-License-Identifier: Apache-2.0
"""Inverse covariances of matches, against NumPy's inverses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.match_covariance import inverse_covariances, invert

MIN_INFORMATIONS = np.full(3, 1e-2)
MIN_VARIANCES = np.array((1e-4, 1e-4, 3e-6))


def positive(rng, smallest):
    """A symmetric matrix with eigenvalues from the smallest up to 1e4."""
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    matrix = turn @ np.diag(10.0 ** rng.uniform(smallest, 4.0, 3)) @ turn.T
    return 0.5 * (matrix + matrix.T)


@settings(deadline=None, max_examples=80)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_matrix_times_its_inverse_is_the_identity(seed):
    matrix = positive(np.random.default_rng(seed), smallest=-1.0)
    inverse = matrix.copy()
    invert(inverse, np.zeros(3))
    np.testing.assert_allclose(matrix @ inverse, np.eye(3), atol=1e-9)
    np.testing.assert_array_equal(inverse, inverse.T)


@settings(deadline=None, max_examples=80)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 4))
def test_certainty_is_bound_and_what_is_open_is_left_so(seed, count):
    rng = np.random.default_rng(seed)
    curvatures = np.array([positive(rng, -8.0) for _ in range(count)]).reshape(-1, 3, 3)
    residuals = rng.uniform(0.0, 0.5, count)
    found = np.empty((count, 3, 3))

    inverse_covariances(curvatures, residuals, 0.03, MIN_INFORMATIONS, MIN_VARIANCES, found)

    for curvature, residual, information in zip(curvatures, residuals, found, strict=True):
        seen = curvature / max(residual, 0.03) ** 2 + np.diag(MIN_INFORMATIONS)
        expected = np.linalg.inv(np.linalg.inv(seen) + np.diag(MIN_VARIANCES))
        scale = np.sqrt(np.diag(expected))
        assert np.abs((information - expected) / np.outer(scale, scale)).max() < 1e-6
        assert (np.linalg.eigvalsh(information) > 0.0).all()


@pytest.mark.parametrize("curvature", [1e3, 1e8, 1e13])
def test_information_along_a_corridor_stays_small(curvature):
    across = np.array((math.sin(0.3), -math.cos(0.3), 2.0))
    found = np.empty((1, 3, 3))

    inverse_covariances(
        curvature * np.outer(across, across)[np.newaxis], np.ones(1), 0.03, MIN_INFORMATIONS,
        MIN_VARIANCES, found,
    )  # fmt: skip

    along = np.array((math.cos(0.3), math.sin(0.3), 0.0))
    assert np.isfinite(found).all()
    assert 0.0 < along @ found[0] @ along < 1.0
    assert across @ found[0] @ across > 1e3


def test_scan_without_information_keeps_the_minimum():
    found = np.empty((1, 3, 3))
    nothing = np.zeros((1, 3, 3))
    inverse_covariances(nothing, np.ones(1), 0.03, MIN_INFORMATIONS, MIN_VARIANCES, found)
    np.testing.assert_allclose(found[0], 1e-2 * np.eye(3), rtol=1e-5)
