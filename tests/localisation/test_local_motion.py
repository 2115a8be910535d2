# SPDX-License-Identifier: Apache-2.0
"""The path of a robot by its own scans, and what of them is kept to be searched."""

from __future__ import annotations

import dataclasses

import numpy as np

from cartoloop.config import Config
from cartoloop.localisation.local_motion import LocalMotion
from cartoloop.sensor.events import LaserScan
from tests.localisation.rooms import ROOM, START, drive, events

PERSON_M = 0.8
BEAMS = slice(60, 66)


def kept_after(shown_from):
    """Return the newest scan of a path, and whether the path has a person shown from a scan on."""
    motion = LocalMotion(Config(), None)
    for k, event in enumerate(events(ROOM, drive(START, 20, step=0.0))):
        if not isinstance(event, LaserScan):
            motion.add_odometry(event)
            continue
        ranges = event.ranges.copy()
        if k // 2 >= shown_from:
            ranges[BEAMS] = PERSON_M
        motion.add_scan(dataclasses.replace(event, ranges=ranges))
    distances = np.hypot(*motion.trail.composite(0.0).points.T)
    return motion.scan, bool(np.any(np.abs(distances - PERSON_M) < 0.1))


def test_who_comes_in_is_not_in_the_scans_that_are_searched():
    scan, is_kept = kept_after(shown_from=15)

    assert np.count_nonzero(scan.moving) > 0
    assert not is_kept


def test_what_has_always_stood_there_is_searched():
    scan, is_kept = kept_after(shown_from=0)

    assert not scan.moving.any()
    assert is_kept
