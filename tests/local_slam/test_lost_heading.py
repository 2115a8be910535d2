# SPDX-License-Identifier: Apache-2.0
"""Lost scans that agree at which other heading they fit."""

from __future__ import annotations

import math

import pytest

from cartoloop.local_slam.lost_heading import (
    AGREE_M,
    AGREE_RAD,
    CLOSE_M,
    CLOSE_RAD,
    LostHeading,
    is_searched,
)
from cartoloop.sensor.pose import Pose, compose

TURN = Pose(0.2, -0.1, 2.0)
"""From where the robot is predicted to where it is, in the local frame."""

PREDICTED = Pose(3.0, 1.0, 0.4), Pose(3.4, 1.3, 0.9)


def agree(*found):
    lost = LostHeading()
    return [lost.add(predicted, pose) for predicted, pose in zip(PREDICTED, found, strict=True)]


def test_two_scans_that_show_the_same_turn_agree():
    first, second = (compose(TURN, predicted) for predicted in PREDICTED)
    assert agree(first, second) == [False, True]
    near = Pose(second.x + 0.9 * AGREE_M, second.y, second.theta - 0.9 * AGREE_RAD)
    assert agree(first, near) == [False, True]


@pytest.mark.parametrize("off", [(1.1 * AGREE_M, 0.0, 0.0), (0.0, 0.0, 1.1 * AGREE_RAD)])
def test_scans_that_show_different_turns_do_not_agree(off):
    first, second = (compose(TURN, predicted) for predicted in PREDICTED)
    assert agree(first, Pose(*(a + b for a, b in zip(second, off, strict=True)))) == [False, False]


@pytest.mark.parametrize(("share", "is_close"), [(0.9, True), (1.1, False)])
def test_scans_that_fit_less_clearly_must_agree_closely(share, is_close):
    first, second = (compose(TURN, predicted) for predicted in PREDICTED)
    for by in ((share * CLOSE_M, 0.0, 0.0), (0.0, 0.0, share * CLOSE_RAD)):
        lost, near = LostHeading(), Pose(*(a + b for a, b in zip(second, by, strict=True)))
        assert not lost.add(PREDICTED[0], first, is_clear=False)
        assert lost.add(PREDICTED[1], near, is_clear=False) == is_close


def test_a_scan_that_fits_nowhere_ends_the_agreement():
    lost = LostHeading()
    assert not lost.add(PREDICTED[0], compose(TURN, PREDICTED[0]))
    assert not lost.add(PREDICTED[0], None)
    assert not lost.add(PREDICTED[1], compose(TURN, PREDICTED[1]))
    assert lost.add(PREDICTED[1], compose(TURN, PREDICTED[1]))


def test_headings_agree_across_the_half_turn():
    turn = Pose(0.0, 0.0, math.pi - 0.01)
    first, second = Pose(1.0, 2.0, 0.0), Pose(1.0, 2.0, 0.02)
    lost = LostHeading()
    lost.add(first, Pose(-1.0, -2.0, math.pi - 0.01))
    found = compose(turn, second)
    assert lost.add(second, found._replace(theta=found.theta - 2.0 * math.pi))


def test_other_headings_are_searched_ever_more_rarely():
    searched = [number for number in range(40) if is_searched(number)]
    assert searched == [2, 3, 6, 7, 14, 15, 30, 31]
