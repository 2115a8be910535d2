# SPDX-License-Identifier: Apache-2.0
"""Localising a live source."""

from __future__ import annotations

import pytest

from cartoloop.errors import InputError
from cartoloop.live.locate_run import get_ready_to_locate, locate_live
from cartoloop.live.message_loop import MessageOptions
from cartoloop.live.messages import EndMessage, parse_message
from cartoloop.live.notices import Notices
from cartoloop.localisation.localizer import Localizer
from cartoloop.stop_request import StopRequest
from tests.localisation.rooms import ROOM, START, apart, drive, known_map, message_lines

POSES = drive(START, 20, step=0.04, turn=0.03)


class Sender:
    """Sends what it is given, then ends, fails, or stays silent."""

    name = "sender"

    def __init__(self, failure=None, ends=True):
        self.failure, self.ends = failure, ends

    def open(self):
        return "listening"

    def run(self, put, notices, stop):
        for line in message_lines(ROOM, POSES):
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
