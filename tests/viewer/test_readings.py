# SPDX-License-Identifier: Apache-2.0
"""The state in plain words, and when it is said."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop import Mapper
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.simulation import office, simulate
from cartoloop.simulation.floor_plan import FloorPlan, World
from cartoloop.viewer.feed import Feed, Update, constraints_of
from cartoloop.viewer.readings import STOPPED, Readings, RealTimeFactor, largest_deviation

NOW = 1000.0

UPDATE = Update(
    submap_poses=np.zeros((0, 3)),
    first_node=0,
    node_poses=np.zeros((0, 3)),
    node_stamps=np.zeros(0),
    adjusted=False,
    first_constraint=0,
    constraints=constraints_of(PoseGraph()),
    finished={},
    num_scans=7,
    skipped={"too dark": 2},
)


@pytest.fixture(autouse=True)
def now(monkeypatch):
    """The clock of the readings, which stands still [s]."""
    monkeypatch.setattr("cartoloop.viewer.readings.perf_counter", lambda: NOW)


def said(readings, *, paused=False):
    content = readings.content({"nodes": 1}, paused=paused)
    return content["state"], content["text"]


def test_what_is_said_from_the_start_to_the_end():
    readings = Readings(10, 100.0)
    assert said(readings) == ("starting", "waiting for the first scan")
    readings.add(replace(UPDATE, time=NOW))
    assert said(readings) == ("mapping", "mapping")
    assert said(readings, paused=True) == ("paused", "paused")
    readings.add(replace(UPDATE, time=NOW, backlog=312))
    assert said(readings) == ("closing_loops", "closing loops: 312 behind")
    readings.end("finishing")
    assert said(readings) == ("finishing", "finishing")
    readings.end("finishing", "matching again, 1 of 2")
    assert said(readings) == ("finishing", "finishing: matching again, 1 of 2")
    readings.end("finished")
    assert said(readings) == ("finished", "finished")


def test_failure_is_reported():
    readings = Readings(10, 100.0)
    readings.end("failed", "the disk is full")

    assert said(readings) == ("failed", "failed: the disk is full")


def test_a_stopped_run_is_not_called_finished():
    readings = Readings(10, 100.0)
    readings.add(replace(UPDATE, time=NOW, backlog=312))
    readings.end("stopped", STOPPED)

    assert said(readings) == ("stopped", "stopped: the last pass is missing, loops may be open")
    assert readings.content({}, paused=False)["backlog"] == 0


def test_only_a_live_scanner_can_be_silent():
    for live, state in ((True, "silent"), (False, "mapping")):
        readings = Readings(None, None, live=live)
        readings.add(replace(UPDATE, time=NOW - 3.0))
        assert said(readings)[0] == state
    assert said(replace_live(Readings(None, None, live=True)))[1] == "sensor silent for 3 s"


def replace_live(readings):
    readings.add(replace(UPDATE, time=NOW - 3.0))
    return readings


def test_figures():
    readings = Readings(10, 100.0)
    readings.add(replace(UPDATE, time=NOW, recorded_s=5.0, stamp=12.5))

    content = readings.content({"nodes": 1}, paused=False)

    assert (content["scans"], content["scans_total"], content["duration_s"]) == (7, 10, 100.0)
    assert (content["time_s"], content["stamp"], content["nodes"]) == (5.0, 12.5, 1)
    assert content["skipped"] == {"too dark": 2}
    assert content["adjustment"] == {"runs": 0, "last_ms": None, "last_iterations": None}
    assert content["real_time_factor"] is None
    assert 10.0 < content["memory_mb"] <= content["peak_memory_mb"] * 1.01


def test_real_time_factor_is_that_of_the_last_seconds():
    factor = RealTimeFactor()
    for second in range(20):
        factor.add(float(second), 10.0 * second if second < 10 else 90.0 + 2.0 * (second - 9))

    assert factor.value == pytest.approx(2.0)


def test_largest_deviation_of_a_known_covariance():
    turn = np.array([(math.cos(0.5), -math.sin(0.5)), (math.sin(0.5), math.cos(0.5))])
    information = np.zeros((3, 3))
    information[:2, :2] = turn @ np.diag((1.0 / 0.3**2, 1.0 / 0.01**2)) @ turn.T
    information[2, 2] = 1e5

    assert largest_deviation(information) == pytest.approx(0.3)


def bare_corridor():
    """Two walls without end."""
    plan = FloorPlan()
    plan.wall((0.0, 0.0), (300.0, 0.0))
    plan.wall((0.0, 2.4), (300.0, 2.4))
    return World("bare", plan.segments(), np.array([(100.0, 1.2), (200.0, 1.2)]))


@pytest.mark.parametrize(("world", "is_uncertain"), [(bare_corridor, True), (office, False)])
def test_only_a_corridor_is_reported_as_uncertain(world, is_uncertain):
    mapper, feed, reported = Mapper(), Feed(), []
    readings = Readings(None, None)
    for event in simulate(world(), seed=1, duration=40.0).events():
        mapper.add(event)
        feed.after_event(mapper)
        if (update := feed.take()) is not None:
            readings.add(update)
            reported.append(said(readings) == ("uncertain", "corridor: length uncertain"))
    mapper.close()

    share = np.mean(reported)
    assert share > 0.5 if is_uncertain else share < 0.05
