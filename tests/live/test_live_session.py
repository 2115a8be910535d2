# SPDX-License-Identifier: Apache-2.0
"""A session hands out a pose for each scan that is mapped, and tidies up when nobody waits."""

from __future__ import annotations

import json

import pytest
from live_room import lines

from cartoloop.live import session as live_session
from cartoloop.live.inbox import Inbox
from cartoloop.live.messages import EndMessage, parse_message
from cartoloop.live.notices import Notices
from cartoloop.live.sequencer import Sequencer
from cartoloop.live.session import LiveSession
from cartoloop.mapper import Mapper


class Sender:
    """Sends what it is given, then the end, then what comes too late."""

    name = "sender"

    def __init__(self, sent, late):
        self.sent = sent
        self.late = late

    def run(self, put, notices, stop):
        for line in self.sent:
            put(parse_message(line))
        put(EndMessage())
        for line in self.late:
            put(parse_message(line))


def run(sent, mapper, reported, late=(), **options):
    """Run a session until its source ends; its notices go to a list. Return what was skipped."""
    notices = Notices(reported.append)
    sender, inbox, sequencer = Sender(sent, late), Inbox(waits=True), Sequencer(notices)
    LiveSession(sender, mapper, inbox, sequencer, notices, **options).run(lambda: False)
    return notices.skipped


@pytest.fixture
def mapper():
    mapper = Mapper(live=True)
    yield mapper
    mapper.close()


def test_each_scan_gets_its_pose(mapper):
    sent, poses = lines(5.0), []

    run(sent, mapper, [], after_scan=poses.append)

    stamps = [m["stamp"] for m in map(json.loads, sent) if m["type"] == "scan"]
    assert [pose.stamp for pose in poses] == stamps
    result = mapper.finish()
    assert [tuple(pose.tf_local_tracking) for pose in poses] == [
        tuple(pose) for pose in result.local_trajectory.tolist()
    ]
    assert all(pose.latency >= 0.0 for pose in poses)


def test_scans_after_the_end_are_counted(mapper):
    scans = [line for line in lines(6.0) if json.loads(line)["type"] == "scan"]
    half = len(scans) // 2

    skipped = run(scans[:half], mapper, reported := [], late=scans[half:])

    # One may come together with the end.
    assert half <= mapper.num_scans <= half + 1
    late = len(scans) - mapper.num_scans
    assert skipped == {"scans that came after the end, not used": late}
    assert any("after the end" in line for line in reported)


def test_it_is_tidied_up_right_after_a_pose_is_out(mapper, monkeypatch):
    happened = []
    monkeypatch.setattr(live_session, "STATUS_S", 0.0)
    monkeypatch.setattr(live_session, "tidy", lambda: happened.append("tidied"))
    reported = []

    run(lines(10.0), mapper, reported, after_scan=lambda scan: happened.append("answered"))

    assert "tidied" in happened
    before = [happened[i - 1] for i, what in enumerate(happened) if what == "tidied"]
    assert set(before) == {"answered"}
    assert any("closures, latency" in line for line in reported)
