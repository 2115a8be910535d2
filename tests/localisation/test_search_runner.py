# SPDX-License-Identifier: Apache-2.0
"""Searches run at once or beside the scans, and a robot does not wait for them."""

from __future__ import annotations

from functools import partial
from threading import Event

import pytest

from cartoloop.localisation import place_search
from cartoloop.localisation.answer import State
from cartoloop.localisation.decision import NOTHING
from cartoloop.localisation.localizer import Localizer
from cartoloop.localisation.search_runner import SearchRunner
from cartoloop.sensor.pose import Pose
from tests.localisation.rooms import ROOM, START, apart, drive, events, known_map

SEARCHED = Pose(1.0, 2.0, 0.5)


def wait_for(go):
    """Search until an event is set."""
    go.wait(60.0)
    return NOTHING


def test_a_search_without_threads_has_ended_when_it_has_begun():
    runner = SearchRunner(in_background=False)
    runner.begin(lambda: NOTHING, SEARCHED)

    assert runner.take() == (NOTHING, SEARCHED)
    assert runner.take() is None


def test_a_search_in_the_background_is_taken_when_it_has_ended():
    go, ended = Event(), Event()
    runner = SearchRunner(in_background=True)
    runner.begin(partial(wait_for, go), SEARCHED)
    assert runner.take() is None
    assert runner.is_busy

    runner.call_when_ended(ended.set)
    go.set()
    assert ended.wait(60.0)
    assert runner.take() == (NOTHING, SEARCHED)
    assert not runner.is_busy


def test_a_forgotten_search_is_not_taken():
    go = Event()
    runner = SearchRunner(in_background=True)
    runner.begin(partial(wait_for, go), SEARCHED)
    runner.forget()
    go.set()

    assert not runner.is_busy
    assert runner.take() is None


def test_the_failure_of_a_search_is_raised():
    def fail():
        raise ValueError("search")

    runner, ended = SearchRunner(in_background=True), Event()
    runner.begin(fail, SEARCHED)
    runner.call_when_ended(ended.set)
    assert ended.wait(60.0)

    with pytest.raises(ValueError, match="search"):
        runner.take()


def test_a_robot_does_not_wait_for_a_search(monkeypatch):
    go, begun = Event(), Event()
    decide = place_search.decide

    def slow(*arguments):
        begun.set()
        go.wait(60.0)
        return decide(*arguments)

    monkeypatch.setattr(place_search, "decide", slow)
    poses = drive(START, 40, step=0.04, turn=0.05)
    localizer = Localizer(known_map(ROOM), live=True)
    before = [a for e in events(ROOM, poses[:10]) if (a := localizer.add(e)) is not None]

    assert begun.wait(60.0)
    assert {answer.state for answer in before} == {State.SEARCHING}
    ended = Event()
    localizer.call_when_searched(ended.set)
    go.set()
    assert ended.wait(60.0)
    later = list(events(ROOM, poses))[20:]
    answers = [answer for event in later if (answer := localizer.add(event)) is not None]
    assert answers[0].state is State.LOCATED
    # Which scan was searched depends on the threads; it was up to 10 scans ago.
    assert apart(poses[10], answers[0].tf_map_tracking)[0] < 0.1
    assert apart(poses[-1], answers[-1].tf_map_tracking)[0] < 0.05
