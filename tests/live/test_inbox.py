# SPDX-License-Identifier: Apache-2.0
"""The queue between source and mapping never grows, and the newest scans win."""

from __future__ import annotations

import math
from threading import Thread

import numpy as np

from cartoloop.live import inbox as inbox_module
from cartoloop.live.inbox import Inbox
from cartoloop.live.messages import EndMessage
from cartoloop.sensor.events import Imu, LaserScan, ScanGeometry

GEOMETRY = ScanGeometry(0.0, 0.1, 1, 0.0, 30.0)


def scan(stamp):
    return LaserScan(stamp, math.nan, np.ones(1), GEOMETRY)


def reading(stamp):
    return Imu(stamp, math.nan, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0))


def stamps(arrivals):
    return [arrival.message.stamp for arrival in arrivals]


def take_all(inbox):
    taken = []
    while arrivals := inbox.take(0.0):
        taken += arrivals
    return taken


def test_the_newest_scans_win_and_no_reading_is_lost():
    inbox = Inbox(max_scans=3)
    for k in range(10):
        inbox.put(reading(k))
        inbox.put(scan(100 + k))

    taken = stamps(take_all(inbox))

    assert [stamp for stamp in taken if stamp >= 100] == [107, 108, 109]
    assert [stamp for stamp in taken if stamp < 100] == list(range(10))
    assert inbox.dropped == {"scans": 7}


def test_one_scan_at_a_time_is_taken():
    inbox = Inbox()
    for message in (reading(0), scan(1), reading(2), scan(3)):
        inbox.put(message)

    assert stamps(inbox.take(0.0)) == [0, 1]
    assert stamps(inbox.take(0.0)) == [2, 3]
    assert inbox.take(0.001) == []


def test_a_flood_of_readings_is_bounded(monkeypatch):
    monkeypatch.setattr(inbox_module, "MAX_OTHERS", 50)
    inbox = Inbox()
    inbox.put(scan(0))
    for k in range(1, 201):
        inbox.put(reading(k))
    inbox.put(EndMessage())

    taken = take_all(inbox)

    assert stamps(taken[:-1]) == [0, *range(151, 201)]
    assert isinstance(taken[-1].message, EndMessage)
    assert inbox.dropped == {"readings": 150}


def test_a_source_may_be_held_up_instead():
    inbox = Inbox(max_scans=2, waits=True)
    sender = Thread(target=lambda: [inbox.put(scan(k)) for k in range(50)])
    sender.start()
    taken = []
    while len(taken) < 50:
        taken += inbox.take(1.0)
    sender.join()

    assert stamps(taken) == list(range(50))
    assert not inbox.dropped


def test_closing_lets_a_source_go():
    inbox = Inbox(max_scans=1, waits=True)
    sender = Thread(target=lambda: [inbox.put(scan(k)) for k in range(3)])
    sender.start()
    inbox.close()
    sender.join(5.0)

    assert not sender.is_alive()
    assert inbox.num_late == 3


def test_the_clock_of_arrivals_never_jumps(monkeypatch):
    inbox = Inbox()
    inbox.put(scan(0))
    monkeypatch.setattr("time.time", lambda: 0.0)
    inbox.put(scan(1))
    first, second = inbox.take(0.0) + inbox.take(0.0)

    assert 0.0 <= second.time - first.time < 5.0
