# SPDX-License-Identifier: Apache-2.0
"""Pages are updated often where it is cheap, and seldom where mapping needs the processor."""

from __future__ import annotations

import pytest

from cartoloop.viewer.budget import (
    FLAT_OUT_PERIODS_S,
    FLAT_OUT_REST_S,
    LONGEST_PERIOD_S,
    MAX_REST_S,
    UPDATE_PERIOD_S,
    Budget,
    Clocks,
)


def run(cost, draw_cost, *, flat_out, speed=1.0, duration=60.0):
    """Return rounds and drawings a second, and what the view took of the process.

    `speed` is the processor time that the process gets in a second.
    """
    budget, clocks = Budget(), Clocks(0.0, 0.0, 0.0)
    rounds = drawn = 0
    while clocks.wall < duration:
        budget.begin(clocks, flat_out=flat_out)
        rounds += 1
        took = cost
        if budget.may_draw(clocks, flat_out=flat_out):
            budget.draw(clocks)
            drawn += 1
            took += draw_cost
        pause = budget.pause_s(clocks)
        clocks = Clocks(clocks.wall + pause, clocks.process + speed * pause, clocks.own + took)
    return rounds / duration, drawn / duration, clocks.own / clocks.process


def test_cheap_updates_come_at_the_shortest_period():
    rounds, drawn, _ = run(1e-4, 1e-4, flat_out=False)

    assert rounds == pytest.approx(1.0 / UPDATE_PERIOD_S, rel=0.02)
    assert drawn == pytest.approx(rounds, rel=0.05)


def test_expensive_updates_come_less_often_within_limits():
    rounds, drawn, _ = run(0.02, 0.05, flat_out=False)

    assert rounds == pytest.approx(1.0 / LONGEST_PERIOD_S, rel=0.02)
    assert drawn == pytest.approx(1.0 / MAX_REST_S, rel=0.1)


def test_growing_submaps_are_drawn_within_the_share():
    rounds, drawn, share = run(0.001, 0.008, flat_out=False)

    assert rounds > 6.0
    assert 1.5 < drawn < 4.0
    assert share < 0.035


@pytest.mark.parametrize("speed", [1.6, 1.0, 0.3])
def test_share_is_the_same_flat_out_on_a_busy_machine(speed):
    rounds, drawn, share = run(0.002, 0.008, flat_out=True, speed=speed)

    assert 1.0 / FLAT_OUT_PERIODS_S[1] <= rounds * 1.02
    assert drawn == pytest.approx(speed / FLAT_OUT_REST_S, rel=0.25)
    assert share < 0.042
