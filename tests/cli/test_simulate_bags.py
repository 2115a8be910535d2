# SPDX-License-Identifier: Apache-2.0
"""``cartoloop simulate -o LOG.bag``: walkers and sweeps, which CARMEN logs cannot hold."""

from __future__ import annotations

import math

import pytest

from cartoloop.cli.main import run
from cartoloop.readers import open_log
from cartoloop.sensor.events import Imu, LaserScan, Odometry


def simulate(*args):
    return run(["simulate", "corridor", "--duration", "6", *map(str, args)])


def test_a_walker_s_bag_holds_an_imu_and_the_time_of_each_beam(tmp_path, capsys):
    bag, truth = tmp_path / "walk.bag", tmp_path / "walk.tum"
    assert simulate("-o", bag, "--tilt-deg", "8", "--distort", "--truth", truth) == 0
    assert "30 scans, 6 s" in capsys.readouterr().out
    events = list(open_log(bag))
    scans = [event for event in events if isinstance(event, LaserScan)]
    assert scans[0].geometry.time_increment > 0.0
    tilted = [e for e in events if isinstance(e, Imu) and abs(e.linear_acceleration[1]) > 0.5]
    assert tilted
    assert not any(isinstance(event, Odometry) for event in events)
    assert len(truth.read_text().splitlines()) == len(scans)


def test_a_level_bag_holds_odometry(tmp_path):
    bag = tmp_path / "drive.bag"
    assert simulate("-o", bag) == 0
    events = list(open_log(bag))
    assert any(isinstance(event, Odometry) for event in events)
    scans = [event for event in events if isinstance(event, LaserScan)]
    assert scans[0].geometry.time_increment == 0.0
    assert math.isclose(scans[-1].time - scans[0].time, 6.0)


@pytest.mark.parametrize(
    ("args", "reason"),
    [
        (("-o", "walk.log", "--tilt-deg", "8"), "give --out a name that ends in .bag"),
        (("-o", "walk.log.gz", "--distort"), "give --out a name that ends in .bag"),
        (("-o", "walk.bag", "--tilt-deg", "60"), "give 0 to 44"),
        (
            (
                "-o",
                "nowhere/walk.bag",
            ),
            "cannot be written",
        ),
    ],
)
def test_impossible_requests_are_reported(args, reason, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert simulate(*args) != 0
    assert reason in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_two_scanners_have_clocks_of_their_own(tmp_path):
    bag, truth = tmp_path / "two.bag", tmp_path / "two.tum"
    assert simulate("-o", bag, "--two-scanners", "--clock-offset", "0.1", "--truth", truth) == 0
    events = list(open_log(bag))
    assert not any(isinstance(event, Imu) for event in events)
    assert any(isinstance(event, Odometry) for event in events)
    stamps = {"front": [], "rear": []}
    for event in events:
        if isinstance(event, LaserScan):
            stamps[event.geometry.sensor.strip("/")].append(event.stamp)
    assert len(stamps["front"]) == 31
    # The rear scanner starts 0.074 s later, and its stamps are 0.1 s late.
    assert stamps["rear"][0] - stamps["front"][0] == pytest.approx(0.174, abs=1e-6)
    rows = [[float(word) for word in line.split()] for line in truth.read_text().splitlines()]
    named = sorted(stamps["front"] + stamps["rear"])
    assert [row[0] for row in rows] == pytest.approx(named, abs=1e-6)
