# SPDX-License-Identifier: Apache-2.0
"""Scale of the odometry's distances, from what scans alone measure of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.local_slam.measured_distance import MeasuredDistance
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.local_slam.odometry_readings import are_measured
from cartoloop.sensor.pose import relative_all

MIN_SCALE, MAX_SCALE = 0.4, 2.5
"""Limits of the scales; odometry beyond them is broken, not badly calibrated: a wrong wheel or gear
makes a factor of two."""

NUM_DISTANCES = 600
"""Number of latest distances that are used: some 600 m."""

MIN_DISTANCES = 10
"""Number of distances needed for an estimate."""

MATCHED_ERROR = 0.005
"""Standard deviation of the scale that matched poses show: the less the scans determine, the more
they show what was assumed."""

MAX_DIFFERENCE = 3.0
"""Two scales contradict each other that differ by more than this multiple of their errors."""

MIN_KNOWN_ERROR = 0.002
"""Least standard deviation of a scale that is known from before, so that it may change."""

MIN_ERROR = 1e-3
"""Lower limit of a standard error: edges of walls are seen from two sides, and comparisons err by a
millimetre on a metre in the mean."""

MIN_LENGTH_M = 0.1
"""Shorter distances are taken to be so long when their noise is scaled to a metre [m]."""

MEDIAN_TO_SIGMA = 1.4826
"""Standard deviation over the median of the absolute value of normally distributed numbers."""

LOSS_SCALE = 3.5
"""Scale of Cauchy's loss as a multiple of the median error: for normal errors it is nearly as good
as least squares, and a metre on which wheels slip hardly counts."""

ROUNDS = 8
"""Rounds of reweighting, after which the estimate changes by less than its noise."""

MIN_TYPICAL_ERROR_M = 1e-4
"""Lower limit of the typical error [m], so that exact data do not divide by zero."""

MAX_RATIO = 1000.0
"""Of measured over predicted distances; beyond, the odometry does not show that the robot moves."""


def with_measured_scale(
    model: OdometryParameters,
    distances: Sequence[MeasuredDistance],
    odometry_times: FloatArray,
    odometry_poses: FloatArray,
    known: OdometryParameters,
    matched_error: float = MATCHED_ERROR,
) -> OdometryParameters:
    """Return a model with the scale of distances that scans alone measured.

    What matched poses show of the scale is little more than what was assumed of it, where
    scans determine little. It counts as long as few distances were measured, unless these
    contradict it.

    Parameters
    ----------
    model : fits the matched poses best.
    distances : as measured.
    odometry_times, odometry_poses : as for :func:`estimate`.
    known : what was known before the run.
    matched_error : standard error of the model's scale; infinite where matched poses do not
        show it.
    """
    used = _inside(distances, model.time_offset, odometry_times)
    if len(used) < MIN_DISTANCES and (math.isinf(matched_error) or not known.knows_scale):
        return model
    estimates, matched = [], (model.translation_scale, matched_error)
    noise, num_metres = known.metre_noise, known.num_metres
    if len(used) >= MIN_DISTANCES:
        predicted = _predicted(used, model, odometry_times, odometry_poses)
        ratio, error, noise = measured_ratio(used, predicted)
        measured = (model.translation_scale * ratio, model.translation_scale * error)
        if are_contradictory(matched, measured):
            matched = (model.translation_scale, math.inf)
        estimates.append(measured)
        num_metres = 0 if math.isnan(noise) else len(used)
    if known.knows_scale:
        estimates.append((known.translation_scale, max(known.scale_error, MIN_KNOWN_ERROR)))
    estimates.append(matched)
    if not any(error < math.inf for _, error in estimates):
        return model  # as of odometry that never moves
    scale, error = combined(estimates)
    scale = min(max(scale, MIN_SCALE), MAX_SCALE)
    return replace(
        model,
        translation_scale=scale,
        scale_error=error,
        metre_noise=noise,
        num_metres=num_metres,
    )


def _inside(
    distances: Sequence[MeasuredDistance], time_offset: float, odometry_times: FloatArray
) -> list[MeasuredDistance]:
    """Return the distances over whose time there is odometry; none if they are few."""
    if len(distances) < MIN_DISTANCES or len(odometry_times) < 2:
        return []
    ends = np.array([(one.begin, one.end) for one in distances]) - time_offset
    is_inside = are_measured(ends[:, 0], odometry_times) & are_measured(ends[:, 1], odometry_times)
    return [one for one, inside in zip(distances, is_inside.tolist(), strict=True) if inside]


def _predicted(
    distances: Sequence[MeasuredDistance],
    model: OdometryParameters,
    odometry_times: FloatArray,
    odometry_poses: FloatArray,
) -> FloatArray:
    """Return the distances as the odometry predicts them, shape (n,) [m]."""
    first, last = (
        np.column_stack(
            [
                np.interp(np.array(times) - model.time_offset, odometry_times, column)
                for column in odometry_poses.T
            ]
        )
        for times in zip(*((one.begin, one.end) for one in distances), strict=True)
    )
    moved = model.predict_all(relative_all(first, last), first[:, 2])
    along: FloatArray = np.sum(moved[:, :2] * np.array([one.along for one in distances]), axis=1)
    return along


def measured_ratio(
    distances: Sequence[MeasuredDistance], predicted: FloatArray
) -> tuple[float, float, float]:
    """Return measured over predicted distance, its standard error, and the noise of a metre.

    Parameters
    ----------
    distances : as measured, at least one.
    predicted : shape (n,), the same as odometry predicts them [m].

    Notes
    -----
    The ratio of two sums that are reweighted: where the wheels slip, odometry is far from what is
    measured. Least squares would take the noise of the odometry for a smaller ratio. The error
    follows from the residuals. The noise of the odometry adds up like steps at random; that of the
    comparisons is in it, too. It is the standard deviation of a metre, from the median [m].
    """
    measured = np.array([one.distance for one in distances])
    information = np.array([one.information for one in distances])
    information /= float(np.median(information))
    ratio, weights = 1.0, information
    for _ in range(ROUNDS):
        squares = information * (measured - ratio * predicted) ** 2
        typical = max(math.sqrt(float(np.median(squares))), MIN_TYPICAL_ERROR_M)
        weights = information / (1.0 + squares / (LOSS_SCALE * typical) ** 2)
        total = float(weights @ predicted)
        moved = float(weights @ measured)
        if total <= moved / MAX_RATIO or total <= 0.0:
            return 1.0, math.inf, math.nan
        ratio = moved / total
    terms = weights * (measured - ratio * predicted)
    error = math.sqrt(float(terms @ terms)) / total
    lengths = np.maximum(np.abs(predicted), MIN_LENGTH_M)
    noise = MEDIAN_TO_SIGMA * float(np.median(np.abs(measured - ratio * predicted) / lengths**0.5))
    return ratio, max(error, MIN_ERROR), noise


def are_contradictory(first: tuple[float, float], second: tuple[float, float]) -> bool:
    """Return whether two values with standard errors contradict each other."""
    return abs(first[0] - second[0]) > MAX_DIFFERENCE * math.hypot(first[1], second[1])


def combined(estimates: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the mean of values with standard errors, weighted by these, and its own.

    At least one error is finite.
    """
    weights = [error**-2 for _, error in estimates if error < math.inf]
    values = [value for value, error in estimates if error < math.inf]
    total = math.fsum(weights)
    mean = math.fsum(w * value for w, value in zip(weights, values, strict=True)) / total
    return mean, total**-0.5
