# SPDX-License-Identifier: Apache-2.0
"""Stretches of the path that scans say little or nothing about: nothing is in sight there."""

from __future__ import annotations

import numpy as np

from cartoloop.quality.motion import Event
from cartoloop.quality.pairs import MapContent
from cartoloop.sensor.spread import show_little

MIN_BLIND_M = 2.0
"""Distance between two nodes from which nothing was matched in between [m]: usually 0.2 to 1 m."""


def blind_stretches(content: MapContent, *, is_whole: bool = True) -> list[Event]:
    """Return the stretches of path that scans say little or nothing about.

    Between nodes, and before the first and after the last, these are too long for scans to overlap.
    Along nodes, all scans show little.

    Parameters
    ----------
    is_whole : whether nodes have all their returns; otherwise these do not show what was seen.
    """
    steps = np.hypot(*np.diff(content.local_trajectory[:, :2], axis=0).T)
    last_scan = len(steps)
    scans = np.unique(np.concatenate(((0,), content.node_scan_index, (last_scan,))))
    paths = np.concatenate(([0.0], np.cumsum(steps)))
    between = np.diff(paths[scans])
    largest = np.maximum.reduceat(steps, scans[:-1]) if len(scans) > 1 else np.zeros(0)
    # A recording of a scan a metre has such distances everywhere: its scans do overlap.
    is_apart = (between > MIN_BLIND_M) & (largest < 0.5 * between)
    little = np.array([is_whole and show_little(points) for points in content.node_points], bool)
    is_little = np.isin(scans, content.node_scan_index[np.flatnonzero(little)])
    is_blind = is_apart | (is_little[:-1] & is_little[1:])
    events = []
    for run in np.split(np.arange(len(between)), np.flatnonzero(np.diff(is_blind)) + 1):
        moved = float(between[run].sum())
        if len(run) and is_blind[run[0]] and moved > MIN_BLIND_M:
            first, last = int(scans[run[0]]), int(scans[run[-1] + 1])
            seconds = float(content.stamps[last] - content.stamps[first])
            events.append(Event(last, seconds, moved, 0.0))
    return events
