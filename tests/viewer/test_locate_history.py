# SPDX-License-Identifier: Apache-2.0
"""States and path of a localisation: all that matters is kept, in bounded memory."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.localisation.answer import State
from cartoloop.sensor.pose import Pose
from cartoloop.viewer import locate_history
from cartoloop.viewer.locate_history import SPACING_M, PathHistory, StateHistory


def test_only_changes_of_the_state_are_kept():
    history = StateHistory()
    assert math.isnan(history.end)
    for stamp, state in enumerate(["searching", "searching", "located", "located", "lost"]):
        history.add(float(stamp), State(state))

    assert history.runs == [(0.0, State.SEARCHING), (2.0, State.LOCATED), (4.0, State.LOST)]
    assert history.end == 4.0


def test_a_state_that_flickers_takes_bounded_memory():
    history = StateHistory()
    for stamp in range(5000):
        history.add(float(stamp), State.LOCATED if stamp % 2 else State.LOST)

    assert len(history.runs) == locate_history.MAX_RUNS
    assert history.runs[-1] == (4999.0, State.LOCATED)


def test_points_of_the_path_are_apart():
    path = PathHistory()
    for step in range(100):
        path.add(Pose(0.3 * SPACING_M * step, 1.0, 0.0))

    points = path.rows(0)
    assert np.diff(points[:, 0]).min() >= SPACING_M - 1e-9
    assert points[:, 2].tolist() == [1.0] + [0.0] * (len(points) - 1)
    assert len(path.rows(len(path) - 2)) == 2


def test_where_the_robot_was_not_located_the_path_is_interrupted():
    path = PathHistory()
    for pose in (Pose(0.0, 0.0, 0.0), Pose(1.0, 0.0, 0.0), None, None, Pose(1.01, 0.0, 0.0)):
        path.add(pose)

    assert path.rows(0).tolist() == [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [1.01, 0.0, 1.0]]


def test_a_long_path_is_kept_whole_in_bounded_memory(monkeypatch):
    monkeypatch.setattr(locate_history, "MAX_POINTS", 50)
    path, begins = PathHistory(), 0
    for step in range(1000):
        lost = step % 100 == 99
        path.add(None if lost else Pose(SPACING_M * step, 0.0, 0.0))
        begins += lost

    points = path.rows(0)
    assert len(points) <= 50
    assert path.revision >= 4
    assert points[0].tolist() == [0.0, 0.0, 1.0]
    assert points[-1, 0] > 90.0 - 2.0
    gaps = np.diff(points[:, 0])[points[1:, 2] == 0.0]
    assert gaps.max() < 4.0 * np.median(gaps)
    assert np.count_nonzero(points[:, 2]) == begins
