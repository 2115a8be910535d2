# SPDX-License-Identifier: Apache-2.0
from itertools import islice

import numpy as np
import pytest

from bench.verdict import benchmark
from bench.verdict.cases import Case, Truth, make_map
from bench.verdict.faults import FAULTS, cut, frozen, jumps, pause, thinned, turn_missing
from cartoloop.sensor.events import LaserScan, Odometry
from cartoloop.simulation import corridor, ring, simulate


@pytest.fixture(scope="module")
def events():
    return list(simulate(ring(), seed=1, duration=120.0).events())


def steps(events):
    readings = [event for event in events if isinstance(event, Odometry)]
    places = np.array([reading.tf_odom_tracking[:2] for reading in readings])
    return np.linalg.norm(np.diff(places, axis=0), axis=1)


@pytest.mark.parametrize("change", [cut, turn_missing])
def test_the_odometry_does_not_know_what_was_cut_out(events, change):
    changed = change(events, np.random.default_rng(0))

    assert len(changed) < len(events) - 30
    assert np.diff([event.time for event in changed]).max() > 3.0
    assert steps(changed).max() < 0.5


def test_the_odometry_bridges_a_pause(events):
    changed = pause(events, np.random.default_rng(0))

    assert len(changed) < len(events)
    assert steps(changed).max() > 1.0


def test_frozen_odometry_stands_still_to_the_end(events):
    moved = steps(frozen(events, np.random.default_rng(0)))

    assert moved[: len(moved) // 20].max() > 0.1
    assert moved[len(moved) // 2 :].max() == 0.0


def test_jumps_move_the_odometry_alone(events):
    changed = jumps(events, np.random.default_rng(0))

    assert np.count_nonzero(steps(changed) > 0.6) >= 3
    assert [event.time for event in changed] == [event.time for event in events]


def test_thinning_keeps_all_odometry(events):
    changed = thinned(6)(events, np.random.default_rng(0))
    scans = [sum(isinstance(e, LaserScan) for e in some) for some in (events, changed)]

    assert scans[1] == scans[0] // 6
    assert len(events) - len(changed) == scans[0] - scans[1]


def test_half_of_the_cases_are_to_be_right():
    cases = list(islice(benchmark.cases(300), 300))
    right = sum(not FAULTS[case.fault].is_fault for case in cases)

    assert len(set(cases)) == len(cases)
    assert 0.4 < right / len(cases) < 0.6
    assert min(case.seed for case in cases) >= benchmark.FIRST_CHECKED_SEED
    assert min(case.seed for case in benchmark.cases(10, 900)) == 900


def test_errors_between_visits_make_a_map_wrong():
    assert Truth(0.35, 0.5, 0.0).is_wrong
    assert Truth(0.2, 0.4, 0.4).is_wrong
    assert not Truth(0.2, 0.4, 0.2).is_wrong


def test_rates_are_counted_by_truth_and_verdict():
    case = Case("ring", 100, "open")
    judged = [
        benchmark.Judged(case, Truth(error, error, 0.0), verdict, 0.02)
        for error, verdict in ((0.1, "good"), (0.1, "doubtful"), (0.5, "wrong"), (0.6, "good"))
    ]

    row = next(iter(benchmark._rows(judged)))

    assert row.figures["wrong ones flagged"].value == 50.0
    assert row.figures["right ones flagged"].value == 50.0
    assert row.figures["wrong, called wrong"].value == 1


def test_maps_that_are_off_in_places_are_left_out():
    case = Case("ring", 100, "open")
    judged = [
        benchmark.Judged(case, Truth(mean, largest, 0.0), verdict, 0.02)
        for mean, largest, verdict in (
            (0.1, 0.4, "good"),
            (0.1, 0.6, "doubtful"),
            (0.5, 0.6, "wrong"),
        )
    ]

    row = next(row for row in benchmark._rows(judged) if "off by" in row.case.get("maps", ""))

    assert row.figures["maps"].value == 2
    assert row.figures["right ones flagged"].value == 0.0
    assert row.figures["wrong ones flagged"].value == 100.0


@pytest.mark.slow
def test_a_map_without_a_fault_is_right_and_good(monkeypatch):
    monkeypatch.setattr("bench.verdict.cases.make_world", lambda *_: corridor(3, length=30.0))

    result, truth = make_map(Case("corridor", 3, "none"))

    assert truth.largest < 0.3
    assert result.quality.verdict == "good"
