# SPDX-License-Identifier: Apache-2.0
"""Veer of the odometry: what the robot turns on each metre driven, and the odometry does not show.

Of a robot with two driven wheels whose radii differ from what is assumed, the odometry turns by a
constant on each metre (0.058 rad/m in the Radish log of the Intel lab). A synchro drive turns its
wheels under a base that is not steered, and its odometry reports the direction of the wheels: they
turn the base by what depends on their direction in it, as a sine (0.023 rad/m in the MIT logs). A
carpet does the same by its pile. It is a milliradian on the step to a scan, but with the same sign
on every step, and matches that follow the prediction bend the map.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.kernels.turn_errors import fit_coefficients, prediction_errors
from cartoloop.local_slam.clock_offset import ERRORS, MIN_LOG_ODDS, log_likelihood
from cartoloop.local_slam.matched_scans import MatchedScans
from cartoloop.local_slam.odometry_readings import are_measured
from cartoloop.sensor.pose import Pose, quick_pose, relative_all

STRETCH_M = 1.0
"""Path over which turns are compared [m]: on a single step, the error of the match is larger."""

MIN_STRETCHES = 60
"""Number of stretches needed for an estimate."""

NUM_PARTS = 4
"""Parts of the drive, which are predicted each from the others."""

VEER_PRIOR, SCALE_PRIOR = 0.05, 0.2
"""Standard deviations of the priors of zero of each coefficient of the veer [rad/m], and of the
error of the turns' scale: what headings do not determine remains near zero."""

KNOWN_PRIOR = 0.005
"""The same of a change of a veer that was accepted before [rad/m]: it weighs as much as a few
stretches, and keeps what was learnt at headings that the latest scans do not have."""

MAX_VEER = 0.3
"""Largest plausible sum of the coefficients [rad/m]; odometry beyond is broken."""


class Veer(NamedTuple):
    """Turn on each metre of reported path that the odometry does not report [rad/m].

    Attributes
    ----------
    constant : at any heading.
    cos, sin : factors of cosine and sine of the reported heading.
    """

    constant: float = 0.0
    cos: float = 0.0
    sin: float = 0.0

    def corrected(self, reported: Pose, heading: float) -> Pose:
        """Return a reported motion with its veer.

        Parameters
        ----------
        reported : motion of the odometry. Backwards, veer turns the other way.
        heading : reported at its begin [rad].
        """
        x, y, theta = reported
        constant, by_cos, by_sin = self
        middle = heading + 0.5 * theta
        rate = constant + by_cos * math.cos(middle) + by_sin * math.sin(middle)
        turn = rate * x
        half = 0.5 * turn
        return quick_pose((x - half * y, y + half * x, theta + turn))

    def corrected_all(self, reported: FloatArray, headings: FloatArray) -> FloatArray:
        """Return :meth:`corrected` of each row, shape (n, 3), equal to the last bit."""
        x, y, theta = reported.T
        # numpy's sine and cosine differ from the C library's in the last digit.
        middles = (headings + 0.5 * theta).tolist()
        cos = np.array([math.cos(angle) for angle in middles])
        sin = np.array([math.sin(angle) for angle in middles])
        turn = (self.constant + self.cos * cos + self.sin * sin) * x
        half = 0.5 * turn
        return np.column_stack((x - half * y, y + half * x, theta + turn))


NO_VEER = Veer()


def estimate_veer(
    scans: MatchedScans,
    odometry_times: FloatArray,
    odometry_poses: FloatArray,
    time_offset: float = 0.0,
    previous: Veer = NO_VEER,
) -> tuple[Veer, int]:
    """Return the veer that explains the turns of matched scans, and the number of stretches.

    Parameters
    ----------
    scans : as matched.
    odometry_times, odometry_poses : float64, shapes (k,), (k, 3), times increasing, headings
        continuous.
    time_offset : a reading is this much newer than the scan of the same stamp [s].
    previous : the veer that was accepted before, which remains until there are enough stretches.

    Notes
    -----
    A constant, and a constant with a sine of the heading, are accepted if they predict each part of
    the drive from the other parts better than no veer does. Errors of the odometry that are random,
    however large, or that belong to one place, do not. What was accepted before needs no margin.
    The scale of the rotation is estimated as well, from the matched turns: on a straight way these
    are zero, and all that is reported is veer.
    """
    if len(odometry_times) < 2:
        return previous, 0
    times = scans.times - time_offset
    is_measured = are_measured(times, odometry_times)
    is_used = scans.is_usable[1:] & is_measured[:-1] & is_measured[1:]
    readings = np.column_stack(
        [np.interp(times, odometry_times, column) for column in odometry_poses.T]
    )
    reported = relative_all(readings[:-1], readings[1:])
    turns = relative_all(scans.poses[:-1], scans.poses[1:])[:, 2]
    path, middle = reported[:, 0], readings[:-1, 2] + 0.5 * reported[:, 2]
    columns = (
        turns - reported[:, 2],
        turns,
        path,
        path * np.cos(middle),
        path * np.sin(middle),
    )
    lengths = np.hypot(reported[:, 0], reported[:, 1])
    stretches = _stretches(np.column_stack(columns), lengths, is_used)
    number = len(stretches)
    if number < MIN_STRETCHES:
        return previous, number
    turned, terms = stretches[:, 0], stretches[:, 1:]
    before = np.array((0.0, *previous))
    count, best = 1, log_likelihood(_prediction_errors(turned, terms[:, :1], before[:1]))
    for more in (2, 4):
        likelihood = log_likelihood(_prediction_errors(turned, terms[:, :more], before[:more]))
        margin = 0.0 if before[more - 1] else MIN_LOG_ODDS
        if likelihood > best + margin:
            count, best = more, likelihood
    if count == 1:
        return NO_VEER, number
    veer = Veer(*_fit(turned, terms[:, :count], before[:count]).tolist()[1:])
    return veer if sum(map(abs, veer)) <= MAX_VEER else NO_VEER, number


def _stretches(columns: FloatArray, lengths: FloatArray, is_used: BoolArray) -> FloatArray:
    """Return the sums of steps' columns over stretches of path without a step that is not used."""
    path = np.cumsum(np.where(is_used, lengths, 0.0))
    breaks = np.cumsum(~is_used)
    # From a break on, the path is measured from it.
    start = np.maximum.accumulate(np.where(is_used, 0.0, path))
    number = np.floor((path - start) / STRETCH_M)
    is_new = np.ones(len(path), dtype=np.bool_)
    is_new[1:] = (np.diff(breaks) != 0) | (np.diff(number) != 0)
    used = np.where(is_used, lengths, 0.0)
    every = np.column_stack((columns * is_used[:, None], used))
    sums = np.add.reduceat(every, np.flatnonzero(is_new), axis=0)
    whole: FloatArray = sums[sums[:, -1] >= 0.5 * STRETCH_M, :-1]
    return whole


def _prediction_errors(turned: FloatArray, terms: FloatArray, before: FloatArray) -> FloatArray:
    """Return the error of each stretch, predicted from the parts of the drive that it is not in."""
    return prediction_errors(turned, terms, before, _sigmas(before), ERRORS[:], NUM_PARTS)


def _fit(turned: FloatArray, terms: FloatArray, before: FloatArray) -> FloatArray:
    """Return the most likely coefficients: errors have Student's distribution of unknown scale.

    Parameters
    ----------
    turned, terms : shapes (n,), (n, k): to be explained, and by what; the first column is a scale.
    before : shape (k,), the coefficients that were accepted before; 0 for none.
    """
    return fit_coefficients(turned, terms, before, _sigmas(before), ERRORS[:])


def _sigmas(before: FloatArray) -> FloatArray:
    """Return the standard deviations of the coefficients' priors, shape (k,)."""
    sigmas = np.where(before == 0.0, VEER_PRIOR, KNOWN_PRIOR)
    sigmas[0] = SCALE_PRIOR
    return sigmas
