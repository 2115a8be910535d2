# SPDX-License-Identifier: Apache-2.0
"""Which match of a lost scan is believed against the odometry."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from cartoloop.config import LocalSlamConfig
from cartoloop.local_slam.lost_search import search_as_lost
from cartoloop.local_slam.scan_fit import MatcherSettings
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import IDENTITY, Pose

USUAL = 0.5
HERE = LeastSquaresMatch(IDENTITY, np.eye(3), 1.6 * USUAL, 1000.0, 1)


def found_at(turn_deg, residual, amply_seen=True, by_odometry=True, here_seen=None):
    """Whether a match elsewhere of a lost scan is believed, turned by so much.

    `here_seen` is the residual of observed points near the prediction; by default that of all.
    """
    pose = Pose(0.5, 0.2, math.radians(turn_deg))
    elsewhere = LeastSquaresMatch(pose, np.diag((1e3, 1e3, 1e3)), residual, 1.0, 1)
    fit = SimpleNamespace(
        settings=MatcherSettings.of(LocalSlamConfig()),
        typical_residual=USUAL,
        prior=IDENTITY,
        prediction=SimpleNamespace(
            by_odometry=by_odometry,
            fallbacks=lambda: (IDENTITY, IDENTITY),
            over_jump=None,
            gap=None,
        ),
        in_submap=lambda pose: pose,
        search=lambda centre, window: centre,
        refine_freely=lambda start: elsewhere,
        residual_of_seen=lambda match: (
            here_seen if match is HERE and here_seen is not None else match.residual
        ),
        fits_as_usual=lambda match: match.residual < 1.3 * USUAL,
        is_determined=lambda match: True,
        is_amply_seen=lambda match: amply_seen,
        cost_against_prior=lambda match, weight: 0.0,
    )
    return search_as_lost(fit, HERE, 3) is elsewhere


@pytest.mark.parametrize("turn_deg", [0.0, 5.0, -5.0])
def test_a_better_match_at_nearly_the_same_heading_is_believed(turn_deg):
    assert found_at(turn_deg, 1.27 * USUAL)


@pytest.mark.parametrize("turn_deg", [7.0, 30.0, -46.0, 358.0 - 46.0])
def test_a_far_turn_is_not_believed_for_a_poor_match(turn_deg):
    assert not found_at(turn_deg, 1.27 * USUAL)


@pytest.mark.parametrize(
    ("here", "gap", "slips"), [(1.05, None, False), (1.6, None, True), (1.6, "a gap", False)]
)
def test_slip_along_a_corridor_is_seen_by_poor_fits(here, gap, slips):
    """Odometry has gone on by 0.5 m, the robot has not; `here` is how badly the scan fits there."""
    prior, at_rest = Pose(0.5, 0.0, 0.0), Pose(0.2, 0.0, 0.0)
    corridor = np.diag((40.0, 1e3, 1e3))

    def refined(start):
        residual = USUAL if start.x < 0.4 else here * USUAL
        return LeastSquaresMatch(start, corridor, residual, 1.0, 1)

    fit = SimpleNamespace(
        settings=MatcherSettings.of(LocalSlamConfig()),
        typical_residual=USUAL,
        prior=prior,
        prediction=SimpleNamespace(
            by_odometry=True, fallbacks=lambda: (at_rest, at_rest), over_jump=None, gap=gap
        ),
        in_submap=lambda pose: pose,
        search=lambda centre, window: centre,
        refine_freely=refined,
        residual_of_seen=lambda match: match.residual,
        fits_as_usual=lambda match: match.residual < 1.3 * USUAL,
        cost_against_prior=lambda match, weight: 0.0,
    )
    best = LeastSquaresMatch(prior, corridor, 1.6 * USUAL, 1000.0, 1)

    assert search_as_lost(fit, best, 3).tf_submap_scan.x == pytest.approx(0.2 if slips else 0.5)


def test_a_far_turn_is_not_believed_where_little_was_observed():
    assert not found_at(30.0, USUAL, amply_seen=False)


def test_a_far_turn_is_believed_where_the_scan_fits_well():
    assert found_at(30.0, USUAL)


@pytest.mark.parametrize(("here_seen", "is_believed"), [(0.9, False), (1.3, True), (0.0, True)])
def test_what_fits_as_usual_near_the_prediction_is_kept(here_seen, is_believed):
    assert found_at(26.0, USUAL, here_seen=here_seen * USUAL) == is_believed


@pytest.mark.parametrize(
    ("residual", "here_seen", "is_believed"),
    [
        (1.33 * USUAL, 0.0, False),  # what has not been observed contradicts no prediction
        (1.33 * USUAL, 1.6 * USUAL, True),
        (USUAL, 0.0, True),
    ],
)
def test_without_odometry_new_places_contradict_nothing(residual, here_seen, is_believed):
    found = found_at(53.0, residual, by_odometry=False, here_seen=here_seen)

    assert found == is_believed
