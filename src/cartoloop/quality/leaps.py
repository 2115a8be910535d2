# SPDX-License-Identifier: Apache-2.0
"""Gaps in a recording across which the poses moved faster than the robot drives.

After a gap the robot is searched for where it may be, and found where scans fit. In buildings whose
parts look alike, that may be a wrong place, which visits then confirm.
"""

from __future__ import annotations

import numpy as np

from cartoloop.quality.motion import Event, gap_rows, is_by_distance, path_steps, usual_interval
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.places import MAX_PLACES, at_scan
from cartoloop.quality.verdict import Kind, Place, Severity
from cartoloop.sensor.time_repair import repair_times

FASTEST_SHARE, MIN_SPEEDS = 0.98, 50
"""Quantile of the speeds from scan to scan that is the robot's highest, and how many show it."""

TIMES_FASTEST, LEAST_M = 1.15, 0.5
"""Poses may move this many times as fast across a gap, and this much farther [m]."""


def leaps(content: MapContent) -> list[Event]:
    """Return the gaps that the robot cannot have crossed; `expected` is how far it can drive."""
    times = repair_times(content.stamps)[0]
    intervals, steps = np.diff(times), path_steps(content.trajectory)
    if not len(steps) or is_by_distance(steps, intervals):
        return []
    usual = usual_interval(intervals)
    shows_speed = (intervals > 0.5 * usual) & (intervals < 2.0 * usual)
    if np.count_nonzero(shows_speed) < MIN_SPEEDS:
        return []
    fastest = float(np.quantile(steps[shows_speed] / intervals[shows_speed], FASTEST_SHARE))
    found = []
    for before in gap_rows(content.stamps, intervals):
        seconds, moved = float(intervals[before]), float(steps[before])
        if moved > TIMES_FASTEST * fastest * seconds + LEAST_M:
            found.append(Event(before + 1, seconds, moved, fastest * seconds))
    return found


def leap_places(found: list[Event], content: MapContent) -> list[Place]:
    """Return the places of such gaps: visits that agree across them may be of places alike."""
    return [
        at_scan(
            event,
            content,
            Kind.GAP,
            Severity.DOUBTFUL,
            f"{event.seconds:.1f} s of the recording are missing, and the poses moved by "
            f"{event.moved:.1f} m meanwhile: the robot drives {event.expected:.1f} m at most",
            "look whether the parts before and after it lie right to each other; map them alone, "
            "and merge the maps",
        )
        for event in found
    ][:MAX_PLACES]
