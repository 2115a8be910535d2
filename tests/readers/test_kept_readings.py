# SPDX-License-Identifier: Apache-2.0
"""Readings that are kept are those that parsing again would give."""

import numpy as np
import pytest

from cartoloop.readers import kept_readings
from cartoloop.readers.carmen import CARMEN
from cartoloop.readers.kept_readings import KeptReadings
from cartoloop.readers.line_format import LineError, Reading
from cartoloop.readers.line_log import LineLog
from cartoloop.sensor.events import LaserScan
from tests.readers.test_bad_items import flaser


def test_kept_readings_come_back_line_by_line():
    kept = KeptReadings()
    ranges = np.array((1.0, 2.0))
    for reading in (None, Reading(1.0, ranges=ranges), LineError("no scan", "it is empty")):
        kept.add(reading)

    assert kept.is_whole
    assert kept.of_line(0) is None
    assert kept.of_line(1).stamp == 1.0
    assert kept.of_line(1).ranges.tolist() == [1.0, 2.0]
    with pytest.raises(LineError, match="it is empty") as raised:
        kept.of_line(2)
    assert raised.value.reason == "no scan"


def test_who_changes_kept_ranges_changes_a_copy():
    kept = KeptReadings()
    kept.add(Reading(1.0, ranges=np.array((1.0, 2.0))))

    kept.of_line(0).ranges[:] = 0.0

    assert kept.of_line(0).ranges.tolist() == [1.0, 2.0]


def test_without_memory_for_all_readings_none_is_kept():
    kept = KeptReadings(max_bytes=2000)
    kept.add(Reading(1.0))
    kept.add(Reading(2.0, ranges=np.zeros(200)))
    kept.add(None)

    assert not kept.is_whole


def test_events_are_the_same_with_and_without_kept_readings(tmp_path, monkeypatch):
    path = tmp_path / "some.log"
    lines = [flaser(f"{i}.0") for i in range(9)]
    lines[3:3] = ["# a comment", "", "FLASER 3 1 2", "ODOM x 0 0 0 0 0 1.0 host 1.0", "SYNC 1"]
    path.write_text("\n".join(lines) + "\nFLASER 3 1 2 3 0")

    def read():
        log = LineLog(path, CARMEN)
        events = [repr(event) for event in log]
        scans = [event.ranges.tolist() for event in log if isinstance(event, LaserScan)]
        return events, scans, log.skipped, [problem.message for problem in log.problems]

    kept = read()
    monkeypatch.setattr(kept_readings.KeptReadings.__init__, "__defaults__", (0,))

    assert read() == kept
    assert len(kept[1]) == 9
