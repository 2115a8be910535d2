# SPDX-License-Identifier: Apache-2.0
"""The stage timer."""

from __future__ import annotations

import pytest

from cartoloop.runtime import stage_timer
from cartoloop.runtime.stage_timer import StageTimer


def test_counts_and_adds_up_calls_of_a_stage():
    timer = StageTimer()
    for seconds in (0.001, 0.003, 0.002):
        timer.record("match", seconds)

    summary = timer.summary()["match"]

    assert summary.calls == 3
    assert summary.total_s == pytest.approx(0.006)
    assert summary.median_ms == pytest.approx(2.0)
    assert summary.p99_ms == pytest.approx(3.0)


def test_median_of_an_even_number_lies_between_the_middle_two():
    timer = StageTimer()
    for seconds in (0.001, 0.002, 0.004, 0.009):
        timer.record("match", seconds)

    assert timer.summary()["match"].median_ms == pytest.approx(3.0)


def test_p99_is_not_exceeded_by_99_of_100_calls():
    timer = StageTimer()
    for milliseconds in range(1, 101):
        timer.record("match", milliseconds / 1e3)

    assert timer.summary()["match"].p99_ms == pytest.approx(99.0)


def test_measures_the_body_even_if_it_raises():
    timer = StageTimer()
    with pytest.raises(ValueError, match="inside"), timer.measure("insert"):
        raise ValueError("inside")

    assert timer.summary()["insert"].calls == 1


def test_stages_that_never_ran_are_left_out():
    timer = StageTimer()
    timer.measure("idle")

    assert timer.summary() == {}


def test_many_calls_are_summed_up_in_bounded_memory(monkeypatch):
    monkeypatch.setattr(stage_timer, "MAX_KEPT", 100)
    timer = StageTimer()
    for number in range(10_000):
        timer.record("match", (number * 7919 % 10_000) / 1e6)  # each of them once, shuffled

    summary = timer.summary()["match"]

    assert len(timer.measure("match").durations) <= 100
    assert summary.calls == 10_000
    assert summary.total_s == pytest.approx(49.995)
    assert summary.median_ms == pytest.approx(5.0, abs=0.5)
    assert summary.p99_ms == pytest.approx(9.9, abs=0.2)
