# SPDX-License-Identifier: Apache-2.0
"""Places on the map, of nodes or scans that show them."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.quality.motion import Event
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.verdict import Kind, Place, Severity

MAX_PLACES = 20
"""Places of one kind that are kept, the largest."""


def of_nodes(
    first: int,
    last: int,
    content: MapContent,
    kind: Kind,
    severity: Severity,
    reason: str,
    advice: str,
) -> Place:
    """Return the place of a part of the path, given its first and last node."""
    nodes = np.arange(first, last + 1)
    points = content.graph.node_poses[nodes, :2]
    return place_around(points, stamps_of(content, nodes), kind, severity, reason, advice)


def extent(points: FloatArray) -> float:
    """Return the diagonal of the box around points [m]."""
    size = points.max(axis=0) - points.min(axis=0)
    return float(np.hypot(size[0], size[1]))


def stamps_of(content: MapContent, nodes: IntArray) -> FloatArray:
    """Return the stamps of nodes, as recorded [s]."""
    stamps: FloatArray = content.stamps[content.node_scan_index[nodes]]
    return stamps


def at_scan(
    event: Event, content: MapContent, kind: Kind, severity: Severity, reason: str, advice: str
) -> Place:
    """Return the place of a scan and the one before."""
    scans = np.array((event.scan - 1, event.scan))
    return place_around(
        content.trajectory[scans, :2], content.stamps[scans], kind, severity, reason, advice
    )


def place_around(
    points: FloatArray,
    stamps: FloatArray,
    kind: Kind,
    severity: Severity,
    reason: str,
    advice: str,
) -> Place:
    """Return the place around points (n, 2) [m], seen at some time stamps."""
    low, high = points.min(axis=0), points.max(axis=0)
    x, y = ((low + high) / 2.0).tolist()
    radius = max(1.0, float(np.hypot(*(high - low))) / 2.0 + 0.5)
    return Place(
        round(x, 3),
        round(y, 3),
        round(radius, 3),
        float(stamps.min()),
        float(stamps.max()),
        kind,
        severity,
        reason,
        advice,
    )
