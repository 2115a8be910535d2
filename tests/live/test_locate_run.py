# SPDX-License-Identifier: Apache-2.0
"""Localising a live source."""

from __future__ import annotations

import pytest

from cartoloop.errors import InputError
from cartoloop.live.locate_run import get_ready_to_locate, locate_live
from cartoloop.live.message_loop import MessageOptions
from cartoloop.live.messages import EndMessage, parse_message
from cartoloop.live.notices import Notices
from cartoloop.localisation.answer import State
from cartoloop.localisation.localizer import Localizer
from cartoloop.stop_request import StopRequest
from cartoloop.viewer.locate_feed import AskedPose
from cartoloop.viewer.locate_view import LocateView
from tests.localisation.rooms import BOX, ROOM, START, apart, drive, known_map, message_lines

POSES = drive(START, 20, step=0.04, turn=0.03)


class Sender:
    """Sends what it is given, then ends, fails, or stays silent."""

    name = "sender"

    def __init__(self, failure=None, ends=True, polygons=ROOM):
        self.failure, self.ends, self.polygons = failure, ends, polygons

    def open(self):
        return "listening"

    def run(self, put, notices, stop):
        for line in message_lines(self.polygons, POSES):
            put(parse_message(line))
        if self.failure is not None:
            raise self.failure
        if self.ends:
            put(EndMessage())
        else:
            stop.wait()


def located(source, options=None, said=None):
    answers = []
    localizer = Localizer(known_map(ROOM), live=True, waits=True)
    locate_live(
        source, localizer, options or MessageOptions(waits=True),
        Notices((said if said is not None else []).append),
        lambda answer, latency: answers.append((answer, latency)), StopRequest(),
    )  # fmt: skip
    return answers


def test_every_scan_of_a_source_is_answered():
    answers = located(Sender())

    assert len(answers) == len(POSES)
    answer, latency = answers[-1]
    assert apart(POSES[-1], answer.tf_map_tracking)[0] < 0.05
    assert latency >= 0.0


def test_a_pose_that_a_page_gives_reaches_the_localiser():
    """The view of a live source, without a page: what a page asks for is put into its feed."""
    localizer = Localizer(known_map(BOX), live=True, waits=True)
    view = LocateView(localizer, "sender", port=0, live=True)
    answers, idles = [], []

    def on_answer(answer, latency):
        answers.append(answer)
        if len(answers) == 5:
            view.feed.ask(AskedPose(1, POSES[5]))
        view.after_answer(answer)

    def on_idle():
        idles.append(len(answers))
        view.idle()

    try:
        locate_live(
            Sender(polygons=BOX), localizer, MessageOptions(waits=True), Notices([].append),
            on_answer, StopRequest(), on_idle,
        )  # fmt: skip
        view.finished()
    finally:
        view.close()

    assert view.failure is None
    assert idles
    assert [answer.state for answer in answers[:5]] == [State.AMBIGUOUS] * 5
    assert answers[-1].state is State.LOCATED
    assert apart(POSES[-1], answers[-1].tf_map_tracking)[0] < 0.1


def test_the_failure_of_a_source_is_raised_after_the_answers():
    with pytest.raises(InputError, match="cable"):
        located(Sender(InputError("the cable is off")))


def test_a_silent_source_ends_after_a_time():
    said = []
    answers = located(Sender(ends=False), MessageOptions(waits=True, end_after=0.3), said)

    assert len(answers) == len(POSES)
    assert any("the source has ended" in line for line in said)


@pytest.mark.slow
def test_kernels_are_compiled_before_the_first_scan():
    known = known_map(ROOM)
    get_ready_to_locate(known)

    assert known.matcher.memory_bytes > 0
