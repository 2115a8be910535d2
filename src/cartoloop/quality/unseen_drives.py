# SPDX-License-Identifier: Apache-2.0
"""Gaps in a recording across which the robot drove far: no scan shows where to.

So long as the poses moved as its speed has it, and scans on both sides are mapped well, nothing
else speaks against them. But odometry, if there is any, is wrong by decimetres over many metres.
"""

from __future__ import annotations

import numpy as np

from cartoloop.quality.encounters import Encounters
from cartoloop.quality.motion import Event, gap_rows, is_by_distance, path_steps
from cartoloop.quality.motion_places import PARTS_ALONE, is_bridged
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.places import MAX_PLACES, at_scan
from cartoloop.quality.verdict import Kind, Place, Severity
from cartoloop.sensor.time_repair import repair_times

UNSEEN_M = 15.0
"""Distance across a gap over which odometry that was calibrated may be wrong by decimetres [m]."""


def unseen_drives(content: MapContent) -> list[Event]:
    """Return the gaps across which the map's poses moved far; `expected` is 0."""
    intervals = np.diff(repair_times(content.stamps)[0])
    steps = path_steps(content.trajectory)
    if is_by_distance(steps, intervals):
        return []
    return [
        Event(before + 1, float(intervals[before]), float(steps[before]), 0.0)
        for before in gap_rows(content.stamps, intervals)
        if steps[before] > UNSEEN_M
    ]


def unseen_places(found: list[Event], met: Encounters, content: MapContent) -> list[Place]:
    """Return the places of such gaps; minor ones where later visits agree across them."""
    return [
        at_scan(
            event,
            content,
            Kind.GAP,
            Severity.MINOR if is_bridged(event, met, content) else Severity.DOUBTFUL,
            f"{event.seconds:.1f} s of the recording are missing, and the robot drove "
            f"{event.moved:.1f} m meanwhile: no scan shows where to",
            PARTS_ALONE,
        )
        for event in found
    ][:MAX_PLACES]
