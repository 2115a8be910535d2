# SPDX-License-Identifier: Apache-2.0
"""The offset between the clocks of another sensor and of the scans, from when both turn."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.kernels import turn_errors
from cartoloop.kernels.turn_errors import ErrorModel, mean_turn_errors
from cartoloop.local_slam.odometry_pace import MAX_PERIOD_S

OFFSETS_S: FloatArray = np.arange(-60.0, 61.0) * 0.02
"""Clock offsets tried [s], in steps of a tenth of the usual time between scans; positive: the
reading is newer than the scan of the same stamp. Radish logs have 0.14 to 0.64 s."""

MIN_TURN_RAD = 0.02
"""Steps that turn by less do not contribute to the offset [rad]: the noise of a match."""

MIN_LOG_ODDS = math.log(20.0)
"""An offset must be this much more likely than none, as a logarithm."""

INDEPENDENT_OFFSETS = 12
"""Number of offsets among those tried that differ in what they explain: turns begin and end within
some 0.2 s."""

MIN_ERROR_RAD = 1e-6
"""Added to the error of a turn [rad], so that exact data do not divide by zero."""

FREEDOM, SCALE_ROUNDS = 4.0, 10
"""Degrees of freedom of the errors' distribution; rounds in which its scale is found."""

ERRORS = ErrorModel(FREEDOM, MIN_ERROR_RAD, SCALE_ROUNDS)
"""The distribution of the errors of turns."""

FIRST_ESTIMATE = 50
"""Number of scans before the first estimate of a calibration: some ten seconds."""


class ClockOffset(NamedTuple):
    """What the turns show about the clock of a sensor.

    Attributes
    ----------
    offset : the one to use [s].
    is_open : whether another one is likelier by enough, but explains too little for the spacing of
        the readings; more turns may show it.
    """

    offset: float
    is_open: bool


def next_estimate(num_scans: int) -> int:
    """Return after how many scans a calibration is estimated again: later as it settles."""
    return num_scans + max(FIRST_ESTIMATE, min(num_scans // 4, 10 * FIRST_ESTIMATE))


def clock_offset(
    times: FloatArray,
    turns: FloatArray,
    turning: BoolArray,
    reading_times: FloatArray,
    heading: FloatArray,
    max_unexplained: float = 0.9,
    previous: float = 0.0,
) -> ClockOffset | None:
    """Return the offset at which a sensor turns when the scans do; None without agreement.

    Parameters
    ----------
    times : of the scans, shape (n,).
    turns, turning : rotation of each step between them [rad], and whether it is used.
    reading_times, heading : of the sensor, shape (k,), k > 1, heading unwrapped [rad].
    max_unexplained : largest share of the turns that may differ at the best offset.
    previous : the offset that was accepted before [s], 0 for none.

    Returns
    -------
    The offset that explains the turns best, if it is better than none by enough
    (:func:`is_likelier_than_none`, :func:`explains_more_than_none`). Otherwise the previous one as
    long as it is better than none at all, or 0.
    """
    known = (times >= reading_times[0]) & (times <= reading_times[-1])
    known = known[:-1] & known[1:]

    def reported(offset: float) -> FloatArray:
        return np.diff(np.interp(times - offset, reading_times, heading))

    turned = turns[turning]
    costs = mean_turn_errors(
        times[:-1][turning], times[1:][turning], turned, OFFSETS_S, reading_times, heading
    )
    best = int(np.argmin(costs))
    if costs[best] > max_unexplained * np.abs(turned).mean():
        return None
    offset = float(OFFSETS_S[best])
    # Of readings that are interpolated, the errors average: as much at the opposite offset.
    candidates = [reported(tried) for tried in (offset, 0.0, -offset)]
    # A clock shows where turns begin and end: there only one of the two turns.
    used = np.max(np.abs(candidates[:2]), axis=0) > MIN_TURN_RAD
    used = (turning | used) & known
    found, none, opposite = (_errors(turns, candidate, used) for candidate in candidates)
    base = max(none, opposite, key=log_likelihood)
    is_likely = is_likelier_than_none(found, base)
    spacing = typical_spacing(times[1:][used] - offset, reading_times)
    is_straight = known & (np.max(np.abs([turns, *candidates[:2]]), axis=0) <= MIN_TURN_RAD)
    noise = _errors(turns, candidates[0], is_straight)
    if is_likely and explains_more_than_none(found, base, spacing, noise):
        return ClockOffset(refined_minimum(OFFSETS_S, costs, best), is_open=False)
    kept = _errors(turns, reported(previous), used)
    is_kept = log_likelihood(kept) > log_likelihood(none)
    may_be_accepted = is_likely and spacing < MAX_PERIOD_S
    return ClockOffset(previous if is_kept else 0.0, may_be_accepted)


def is_likelier_than_none(errors: FloatArray, errors_of_none: FloatArray) -> bool:
    """Return whether an offset explains the turns better than none, and not by chance.

    The logarithm of the likelihood must grow by `MIN_LOG_ODDS` and by that of the number of
    independent offsets tried; steps count half, since neighbours share a scan.

    Parameters
    ----------
    errors, errors_of_none : differences of the turns, apart from their scale, with the offset and
        without, shapes (n,) [rad].
    """
    gain = log_likelihood(errors) - log_likelihood(errors_of_none)
    return 0.5 * gain > MIN_LOG_ODDS + math.log(INDEPENDENT_OFFSETS)


def explains_more_than_none(
    errors: FloatArray, errors_of_none: FloatArray, spacing: float, noise: FloatArray
) -> bool:
    """Return whether an offset explains more of the turns than interpolation alone does.

    The motion between two readings is assumed to be uniform. The further apart they are, the less
    is that true, and an offset then explains turns because it averages readings. So the mean error
    must decrease by a share that grows with the spacing, until readings determine no speed and
    hence no offset. What the noise of the matches adds to it stays whatever the offset, and does
    not count.

    Parameters
    ----------
    errors, errors_of_none : as in :func:`is_likelier_than_none`.
    spacing : time between readings [s].
    noise : differences of the turns where the robot drives straight on, shape (m,) [rad].
    """
    of_noise = np.abs(noise).mean() if len(noise) else 0.0
    squares = [
        max(np.abs(some).mean() ** 2 - of_noise**2, 0.0) for some in (errors, errors_of_none)
    ]
    return bool(squares[0] < max(1.0 - spacing / MAX_PERIOD_S, 0.0) ** 2 * squares[1])


def _errors(turns: FloatArray, reported: FloatArray, used: BoolArray) -> FloatArray:
    """Return turns less the reported ones at the scale that fits them best, where they are used."""
    true, seen = turns[used], reported[used]
    squares = float(np.sum(seen**2))
    return true - (float(np.sum(true * seen)) / squares if squares > 0.0 else 1.0) * seen


def log_likelihood(errors: FloatArray) -> float:
    """Return that of errors with Student's distribution of unknown scale, up to a constant.

    Its tails are long: a few wrong matches do not decide.

    Parameters
    ----------
    errors : float64, shape (n,) [rad].
    """
    return turn_errors.log_likelihood(errors, *ERRORS)


def typical_spacing(times: FloatArray, reading_times: FloatArray) -> float:
    """Return the median time between the two readings around each of some times [s]."""
    after = np.clip(np.searchsorted(reading_times, times), 1, len(reading_times) - 1)
    return float(np.median(reading_times[after] - reading_times[after - 1]))


def refined_minimum(grid: FloatArray, costs: FloatArray, best: int) -> float:
    """Return the minimum of a parabola through the lowest cost and its neighbours."""
    if not 0 < best < len(grid) - 1:
        return float(grid[best])
    left, middle, right = costs[best - 1 : best + 2]
    curvature = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / curvature if curvature > 0.0 else 0.0
    return float(grid[best] + shift * (grid[1] - grid[0]))
