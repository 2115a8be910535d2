# SPDX-License-Identifier: Apache-2.0
"""What turns of another sensor leave unexplained of the turns of matched scans.

Errors have Student's distribution of unknown scale: its tails are long, so that a few wrong matches
do not decide.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop._jit import borrowing_kernel, kernel
from cartoloop.arrays import FloatArray


class ErrorModel(NamedTuple):
    """How errors are distributed.

    Attributes
    ----------
    freedom : degrees of freedom of Student's distribution.
    least : added to each error, so that exact data do not divide by zero.
    rounds : in which the scale is found.
    """

    freedom: float
    least: float
    rounds: int


@kernel
def log_likelihood(errors: FloatArray, freedom: float, least: float, rounds: int) -> float:
    """Return the log-likelihood of errors, up to a constant.

    Parameters
    ----------
    errors : float64, shape (n,).
    freedom, least, rounds : fields of an :class:`ErrorModel`.
    """
    count = errors.shape[0]
    scale = 0.0
    for k in range(count):
        scale += errors[k] ** 2 + least**2
    scale /= count
    for _ in range(rounds):
        weighted = 0.0
        for k in range(count):
            square = errors[k] ** 2 + least**2
            weighted += (freedom + 1.0) / (freedom + square / scale) * square
        scale = weighted / count
    spread = 0.0
    for k in range(count):
        spread += math.log1p((errors[k] ** 2 + least**2) / (freedom * scale))
    return float(-0.5 * (count * math.log(scale) + (freedom + 1.0) * spread))


@kernel
def fit_coefficients(
    turned: FloatArray,
    terms: FloatArray,
    before: FloatArray,
    sigmas: FloatArray,
    model: tuple[float, float, int],
) -> FloatArray:
    """Return the most likely coefficients of what explains turns, shape (k,).

    Parameters
    ----------
    turned, terms : float64, shapes (n,), (n, k): to be explained, and by what; n > 0.
    before, sigmas : float64, shape (k,), means and standard deviations of their priors.
    model : fields of an :class:`ErrorModel`.
    """
    errors = ErrorModel(model[0], model[1], model[2])
    solution = before.copy()
    _fit(turned, terms, before, sigmas, errors, -1, 1, solution)
    return solution


@kernel
def prediction_errors(
    turned: FloatArray,
    terms: FloatArray,
    before: FloatArray,
    sigmas: FloatArray,
    model: tuple[float, float, int],
    num_parts: int,
) -> FloatArray:
    """Return the error of each turn, predicted from the parts that it is not in, shape (n,).

    Parameters
    ----------
    turned, terms, before, sigmas, model : as for :func:`fit_coefficients`; the turns are divided
        into `num_parts` parts in turn, n > num_parts > 1.
    """
    errors_of = ErrorModel(model[0], model[1], model[2])
    errors = np.empty(turned.shape[0])
    solution = np.empty(before.shape[0])
    for part in range(num_parts):
        _fit(turned, terms, before, sigmas, errors_of, part, num_parts, solution)
        for k in range(turned.shape[0]):
            if k * num_parts // turned.shape[0] == part:
                errors[k] = _error(turned, terms, solution, k)
    return errors


@borrowing_kernel
def _error(turned: FloatArray, terms: FloatArray, solution: FloatArray, k: int) -> float:
    explained = 0.0
    for i in range(solution.shape[0]):
        explained += terms[k, i] * solution[i]
    return float(turned[k] - explained)


@kernel
def _fit(
    turned: FloatArray,
    terms: FloatArray,
    before: FloatArray,
    sigmas: FloatArray,
    model: ErrorModel,
    left_out: int,
    num_parts: int,
    out_solution: FloatArray,
) -> None:
    """Write the coefficients by iteratively reweighted least squares, without one of the parts."""
    count, size, used = turned.shape[0], before.shape[0], 0
    out_solution[:] = before
    scale = 0.0
    for k in range(count):
        if k * num_parts // count != left_out:
            scale += _error(turned, terms, before, k) ** 2
            used += 1
    scale = scale / used + model.least**2
    normal, right = np.empty((size, size)), np.empty(size)
    for _ in range(model.rounds):
        normal[:] = 0.0
        right[:] = 0.0
        weighted = 0.0
        for k in range(count):
            if k * num_parts // count == left_out:
                continue
            square = _error(turned, terms, out_solution, k) ** 2 + model.least**2
            weight = (model.freedom + 1.0) / (model.freedom + square / scale)
            weighted += weight * square
            for i in range(size):
                right[i] += terms[k, i] * weight * turned[k]
                for j in range(i + 1):
                    normal[i, j] += terms[k, i] * weight * terms[k, j]
        scale = weighted / used
        for i in range(size):
            precision = scale / sigmas[i] ** 2
            normal[i, i] += precision
            right[i] += precision * before[i]
        _solve_by_cholesky(normal, right)
        out_solution[:] = right


@borrowing_kernel
def _solve_by_cholesky(matrix: FloatArray, vector: FloatArray) -> None:
    """Solve a positive definite system in place; only the lower triangle is used."""
    size = vector.shape[0]
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for m in range(j):
                total -= matrix[i, m] * matrix[j, m]
            matrix[i, j] = math.sqrt(total) if i == j else total / matrix[j, j]
        for m in range(i):
            vector[i] -= matrix[i, m] * vector[m]
        vector[i] /= matrix[i, i]
    for i in range(size - 1, -1, -1):
        for m in range(i + 1, size):
            vector[i] -= matrix[m, i] * vector[m]
        vector[i] /= matrix[i, i]


@kernel
def mean_turn_errors(
    begins: FloatArray,
    ends: FloatArray,
    turned: FloatArray,
    offsets: FloatArray,
    reading_times: FloatArray,
    heading: FloatArray,
) -> FloatArray:
    """Return by how much turns differ from those of a sensor in the mean, for each clock offset.

    Parameters
    ----------
    begins, ends, turned : float64, shape (n,), of the turns [s], [s], [rad]; n > 0.
    offsets : float64, shape (m,), that the sensor's clock is ahead [s].
    reading_times, heading : float64, shape (k,), of the sensor, times increasing, heading unwrapped
        [rad]; k > 1. It is interpolated, and constant before and after.

    Returns
    -------
    float64, shape (m,) [rad].
    """
    costs = np.empty(offsets.shape[0])
    for row in range(offsets.shape[0]):
        total = 0.0
        place = next_place = 0
        for k in range(turned.shape[0]):
            begin, end = begins[k] - offsets[row], ends[k] - offsets[row]
            place = _place_of(begin, reading_times, place)
            next_place = _place_of(end, reading_times, next_place)
            reported = _at(end, reading_times, heading, next_place) - _at(
                begin, reading_times, heading, place
            )
            total += abs(turned[k] - reported)
        costs[row] = total / turned.shape[0]
    return costs


@borrowing_kernel
def _place_of(time: float, reading_times: FloatArray, place: int) -> int:
    """Return the last reading that is not after a time, but for the last one, from a guess on."""
    while place > 0 and time < reading_times[place]:
        place -= 1
    while place < reading_times.shape[0] - 2 and time >= reading_times[place + 1]:
        place += 1
    return place


@borrowing_kernel
def _at(time: float, reading_times: FloatArray, heading: FloatArray, place: int) -> float:
    """Return the heading at a time between a reading and the next; the nearest one outside."""
    before, after = reading_times[place], reading_times[place + 1]
    if time <= before:
        return float(heading[place])
    if time >= after:
        return float(heading[place + 1])
    slope = (heading[place + 1] - heading[place]) / (after - before)
    return float(slope * (time - before) + heading[place])
