# SPDX-License-Identifier: Apache-2.0
"""What turns leave unexplained, against references by whole arrays."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.kernels.turn_errors import (
    ErrorModel,
    fit_coefficients,
    log_likelihood,
    mean_turn_errors,
    prediction_errors,
)

MODEL = ErrorModel(4.0, 1e-6, 10)
seeds = st.integers(0, 1000)


def naive_log_likelihood(errors):
    squares = errors**2 + MODEL.least**2
    scale = squares.mean()
    for _ in range(MODEL.rounds):
        weights = (MODEL.freedom + 1.0) / (MODEL.freedom + squares / scale)
        scale = (weights * squares).mean()
    spread = np.log1p(squares / (MODEL.freedom * scale)).sum()
    return -0.5 * (len(errors) * math.log(scale) + (MODEL.freedom + 1.0) * spread)


def naive_fit(turned, terms, before, sigmas):
    prior = np.diag(sigmas**-2)
    solution, scale = before, np.mean((turned - terms @ before) ** 2) + MODEL.least**2
    for _ in range(MODEL.rounds):
        squares = (turned - terms @ solution) ** 2 + MODEL.least**2
        weights = (MODEL.freedom + 1.0) / (MODEL.freedom + squares / scale)
        scale = (weights * squares).mean()
        normal = (terms.T * weights) @ terms + scale * prior
        right = terms.T @ (weights * turned) + scale * (prior @ before)
        solution = np.linalg.solve(normal, right)
    return solution


def naive_prediction_errors(turned, terms, before, sigmas, num_parts):
    part = np.arange(len(turned)) * num_parts // len(turned)
    errors = np.empty(len(turned))
    for number in range(num_parts):
        held = part == number
        solution = naive_fit(turned[~held], terms[~held], before, sigmas)
        errors[held] = turned[held] - terms[held] @ solution
    return errors


def drive(seed, count, size):
    """Return turns, what explains them, and the priors of its coefficients."""
    rng = np.random.default_rng(seed)
    terms = rng.normal(0.0, 1.0, (count, size))
    turned = terms @ rng.normal(0.0, 0.1, size) + 0.01 * rng.standard_t(3.0, count)
    before = np.where(rng.random(size) < 0.5, 0.0, rng.normal(0.0, 0.1, size))
    return turned, terms, before, rng.uniform(0.01, 0.3, size)


@given(seeds, st.integers(1, 60), st.floats(0.0, 1.0))
def test_the_likelihood_of_errors_is_that_of_students_law(seed, count, size):
    errors = size * np.random.default_rng(seed).standard_t(3.0, count)
    expected = naive_log_likelihood(errors)
    assert log_likelihood(errors, *MODEL) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(seeds, st.integers(5, 60), st.integers(1, 4))
def test_the_likeliest_coefficients_are_found(seed, count, size):
    turned, terms, before, sigmas = drive(seed, count, size)
    found = fit_coefficients(turned, terms, before, sigmas, MODEL[:])
    expected = naive_fit(turned, terms, before, sigmas)
    assert found == pytest.approx(expected, rel=1e-7, abs=1e-9)


@given(seeds, st.integers(12, 60), st.integers(1, 4), st.integers(2, 5))
def test_parts_are_predicted_from_the_others(seed, count, size, num_parts):
    turned, terms, before, sigmas = drive(seed, count, size)
    found = prediction_errors(turned, terms, before, sigmas, MODEL[:], num_parts)
    expected = naive_prediction_errors(turned, terms, before, sigmas, num_parts)
    assert found == pytest.approx(expected, rel=1e-7, abs=1e-9)


@given(seeds, st.integers(1, 30), st.integers(2, 30))
def test_turns_are_compared_at_each_clock_offset(seed, count, num_readings):
    rng = np.random.default_rng(seed)
    begins = rng.uniform(-2.0, 12.0, count)
    ends = begins + rng.uniform(0.0, 1.0, count)
    times = np.unique(rng.uniform(0.0, 10.0, num_readings + 2))
    heading = np.cumsum(rng.normal(0.0, 0.5, len(times)))
    turned, offsets = rng.normal(0.0, 0.5, count), np.linspace(-1.0, 1.0, 9)
    found = mean_turn_errors(begins, ends, turned, offsets, times, heading)
    for offset, cost in zip(offsets.tolist(), found.tolist(), strict=True):
        reported = np.interp(ends - offset, times, heading)
        reported -= np.interp(begins - offset, times, heading)
        assert cost == pytest.approx(float(np.abs(turned - reported).mean()), abs=1e-12)
