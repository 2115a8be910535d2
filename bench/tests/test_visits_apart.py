# SPDX-License-Identifier: Apache-2.0
"""How far apart the walls of two visits are, of known drives and known errors."""

from __future__ import annotations

import numpy as np
import pytest

from bench.robustness import visits_apart
from bench.robustness.visits_apart import agreement, map_points
from cartoloop.errors import InputError
from cartoloop.evaluation.trajectories import Trajectory
from cartoloop.sensor.events import LaserScan
from cartoloop.simulation import make_world, simulate


@pytest.fixture(scope="module")
def recording():
    return simulate(make_world("ring", 3), seed=3)


@pytest.fixture(scope="module")
def scans(recording):
    return [event for event in recording.events() if isinstance(event, LaserScan)]


@pytest.fixture(autouse=True)
def fewer_samples(monkeypatch):
    monkeypatch.setattr(visits_apart, "SAMPLES", 2000)


def test_true_poses_leave_only_the_noise(recording, scans):
    found = agreement(*map_points(scans, Trajectory(recording.stamps, recording.true_poses)))
    assert found.places > 1000
    assert found.median <= found.mean < found.most < 0.005


def test_a_second_lap_that_is_displaced_stands_apart(recording, scans):
    """By 15 cm in both directions, so that walls of both are displaced by it."""
    poses = recording.true_poses.copy()
    poses[recording.stamps > np.median(recording.stamps), :2] += 0.15
    right, wrong = (
        agreement(*map_points(scans, Trajectory(recording.stamps, each)))
        for each in (recording.true_poses, poses)
    )
    assert wrong.median == pytest.approx(0.15, abs=0.005)
    assert wrong.entropy > right.entropy + 1.0


def test_what_was_seen_once_cannot_be_compared():
    points = np.random.default_rng(1).uniform(0.0, 5.0, (500, 2))
    with pytest.raises(InputError, match="no place was seen twice"):
        agreement(points, np.zeros(500))


def test_the_command_prints_a_line_for_each_trajectory(recording, tmp_path, capsys):
    log, tum, other = tmp_path / "drive.log", tmp_path / "true.tum", tmp_path / "other.tum"
    recording.write_log(log)
    recording.write_truth(tum)
    rows = np.loadtxt(tum)
    rows[:, 0] += 1e6
    np.savetxt(other, rows)
    assert visits_apart.main([str(log), str(tum), str(tum)]) == 0
    assert capsys.readouterr().out.count("walls of different visits") == 2
    assert visits_apart.main([str(log), str(other)]) == 1
    assert "is it of this log?" in capsys.readouterr().err
    assert visits_apart.main([str(log)]) == 2
