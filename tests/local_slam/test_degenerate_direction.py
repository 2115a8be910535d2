# SPDX-License-Identifier: Apache-2.0
"""The direction that a match leaves open, and what decides along it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.config import LocalSlamConfig
from cartoloop.local_slam.degenerate_direction import (
    constrain_degenerate_direction,
    degenerate_direction,
    is_determined,
    shows_heading,
    where_prior_leads,
)
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import Pose

CONFIG = LocalSlamConfig()


def match_of(information):
    """A match with this information; all else is zero."""
    fields = dict.fromkeys(LeastSquaresMatch._fields, 0.0)
    return LeastSquaresMatch(**fields | {"information": np.array(information, dtype=np.float64)})


@pytest.mark.parametrize("along", [0.0, 0.4, math.pi / 2, 2.8])
def test_the_degenerate_direction_is_along_the_corridor(along):
    ahead = np.array((math.cos(along), math.sin(along)))
    across = np.array((-math.sin(along), math.cos(along)))
    information = np.eye(3)
    information[:2, :2] = 4.0 * np.outer(ahead, ahead) + 100.0 * np.outer(across, across)
    ratio, direction = degenerate_direction(match_of(information))
    assert ratio == pytest.approx(0.04)
    assert abs(math.remainder(direction - along, math.pi)) == pytest.approx(0.0, abs=1e-9)


def test_a_square_room_has_no_degenerate_direction():
    assert degenerate_direction(match_of(np.eye(3)))[0] == pytest.approx(1.0)


def test_a_match_without_information_is_degenerate():
    assert degenerate_direction(match_of(np.zeros((3, 3))))[0] == 0.0


def information_of(points):
    """J^T J of points whose residuals are distances along both axes, for a robot at the origin."""
    rows = [((1.0, 0.0, -y), (0.0, 1.0, x)) for x, y in points]
    jacobian = np.array(rows).reshape(-1, 3)
    return jacobian.T @ jacobian


@pytest.mark.parametrize(("width", "shown"), [(0.3, False), (20.0, True)])
def test_a_small_object_shows_no_heading(width, shown):
    points = [(3.0, y) for y in np.linspace(-0.5 * width, 0.5 * width, 20)]
    match = match_of(information_of(points))
    assert match.information[2, 2] > 180.0  # though it does, if the position is known
    assert shows_heading(match) is shown


def test_a_match_without_information_shows_no_heading():
    assert not shows_heading(match_of(np.zeros((3, 3))))


def corridor_match(along=0.06):
    """A match displaced from the prediction by `along` in a degenerate direction."""
    information = np.diag((100.0, 10.0, 500.0))
    return LeastSquaresMatch(Pose(0.0, along, 0.0), information, 0.2, 1.0, 5)


@pytest.mark.parametrize(("pixel_information", "kept"), [(0.0, 0.0), (1e4, 0.5), (math.inf, 1.0)])
def test_the_prior_decides_along_a_degenerate_direction(pixel_information, kept):
    prior, sigma = Pose(0.0, 0.0, 0.0), 0.01
    prior_information = np.array((sigma**-2, 0.0, 0.0, sigma**-2, 0.0, 1.0))
    config = CONFIG.prediction.model_copy(
        update={"failure_scale": 1e6, "spurious_information": 0.25}
    )
    along = 0.06 * 1e5 / (1e5 + sigma**-2)  # where points of that weight and the prior balance
    held = constrain_degenerate_direction(
        corridor_match(along), prior, prior_information, 1e4, config, pixel_information
    )
    assert held.x == pytest.approx(0.0)
    expected = along if math.isinf(pixel_information) else kept * 0.06
    assert held.y == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("prior", "ratio", "expected"),
    [
        (Pose(3.0, 0.2, 0.1), 0.05, Pose(3.0, 0.0, 0.0)),  # along the walls alone
        (Pose(3.0, 0.2, 0.1), 0.5, Pose(0.0, 0.0, 0.0)),  # the match determines where it is
        (Pose(3.0, 1.0, 0.0), 0.05, Pose(0.0, 0.0, 0.0)),  # also across them
        (Pose(3.0, 0.0, 1.0), 0.05, Pose(0.0, 0.0, 0.0)),  # turned
    ],
)
def test_odometry_decides_along_bare_walls(prior, ratio, expected):
    match = match_of(np.diag((ratio, 1.0, 1.0)))._replace(tf_submap_scan=Pose(0.0, 0.0, 0.0))
    assert where_prior_leads(match, prior, 0.04) == pytest.approx(expected)


@pytest.mark.parametrize(("ratio", "expected"), [(0.04, False), (0.06, True)])
def test_a_match_determines_more_than_the_noise_of_pixels(ratio, expected):
    assert is_determined(ratio, 0.02) == expected
