# SPDX-License-Identifier: Apache-2.0
"""What a map shows in a rectangle."""

from __future__ import annotations

import numpy as np

from cartoloop.map_data import MapData
from cartoloop.map_editing.rectangle import Rectangle, returns_inside
from cartoloop.map_editing.removal import is_known_in
from cartoloop.map_editing.sessions import main_part
from cartoloop.sensor.pose import Pose, relative_all
from cartoloop.sensor.scan_points import ScanPoints


def is_seen(shown: MapData, area: Rectangle) -> bool:
    """Return whether a rectangle of a map holds cells that were observed, or returns of nodes."""
    graph = shown.graph
    submaps, nodes = main_part(shown, shown.sessions)
    corners = relative_all(graph.submap_poses[submaps], np.array(area.corner))
    for submap, corner in zip(submaps.tolist(), corners.tolist(), strict=True):
        if is_known_in(shown.submap_grids[submap], area._replace(corner=Pose(*corner))):
            return True
    if not len(shown.node_points):
        return False
    points = ScanPoints.of([shown.node_points[node] for node in nodes.tolist()])
    return bool(returns_inside(area, points, graph.node_poses[nodes]).any())


def extent(shown: MapData) -> str:
    """Return where the path of a map lies, as a clause."""
    _, nodes = main_part(shown, shown.sessions)
    if not len(nodes):
        return "it has no path"
    places = shown.graph.node_poses[nodes, :2]
    (left, bottom), (right, top) = places.min(axis=0), places.max(axis=0)
    return f"its path lies from x {left:.1f} to {right:.1f} m, y {bottom:.1f} to {top:.1f} m"
