# SPDX-License-Identifier: Apache-2.0
"""Stretches of the path that scans say little or nothing about: nothing is in sight there."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import BoolArray
from cartoloop.quality.motion import Event
from cartoloop.quality.pairs import MapContent

MIN_BLIND_M = 2.0
"""Distance between two nodes from which nothing was matched in between [m]: usually 0.2 to 1 m."""

LITTLE_SPREAD_M2 = 50.0
"""Squared distances of returns from their middle, added up [m^2]. Scans of less show little of the
heading: in rooms it is hundreds, of a box ten at most."""


def blind_stretches(content: MapContent) -> list[Event]:
    """Return the stretches of path that scans say little or nothing about.

    Between nodes, and before the first and after the last, these are too long for scans to overlap.
    Along nodes, all scans show little.
    """
    steps = np.hypot(*np.diff(content.local_trajectory[:, :2], axis=0).T)
    last_scan = len(steps)
    scans = np.unique(np.concatenate(((0,), content.node_scan_index, (last_scan,))))
    paths = np.concatenate(([0.0], np.cumsum(steps)))
    between = np.diff(paths[scans])
    largest = np.maximum.reduceat(steps, scans[:-1]) if len(scans) > 1 else np.zeros(0)
    # A recording of a scan a metre has such distances everywhere: its scans do overlap.
    is_apart = (between > MIN_BLIND_M) & (largest < 0.5 * between)
    little = np.isin(scans, content.node_scan_index[_show_little(content)])
    is_blind = is_apart | little[:-1] | little[1:]
    events = []
    for run in np.split(np.arange(len(between)), np.flatnonzero(np.diff(is_blind)) + 1):
        moved = float(between[run].sum())
        if len(run) and is_blind[run[0]] and moved > MIN_BLIND_M:
            first, last = int(scans[run[0]]), int(scans[run[-1] + 1])
            seconds = float(content.stamps[last] - content.stamps[first])
            events.append(Event(last, seconds, moved, 0.0))
    return events


def _show_little(content: MapContent) -> BoolArray:
    """Return which nodes have returns of nothing but a small object, or of one far away."""
    spreads = [
        float(((points - points.mean(axis=0)) ** 2).sum()) if len(points) else 0.0
        for points in content.node_points
    ]
    return np.array(spreads) < LITTLE_SPREAD_M2
