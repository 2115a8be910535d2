# SPDX-License-Identifier: Apache-2.0
"""The motion of each session of a map by itself: between two sessions, the robot is elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.quality.corridors import Corridors, corridors
from cartoloop.quality.motion import Event, Standing
from cartoloop.quality.pairs import MapContent
from cartoloop.session import Session, ranges
from cartoloop.submaps.finished_grid import FinishedGrid

APART_M = 1e6
"""Path length from one session to the next [m]: longer than any path in a session."""


@dataclass(frozen=True)
class SessionContent:
    """The scans and nodes of one session; its graph has no constraints, and no submaps."""

    stamps: FloatArray
    trajectory: FloatArray
    local_trajectory: FloatArray
    graph: PoseGraph
    node_scan_index: IntArray
    node_points: Sequence[NDArray[np.float64]]
    sessions: tuple[Session, ...]

    @property
    def submap_grids(self) -> list[FinishedGrid]:
        """Of none."""
        return []

    @property
    def node_parts(self) -> IntArray:
        """All are of one part."""
        return np.zeros(self.graph.num_nodes, dtype=np.int64)

    @property
    def submap_parts(self) -> IntArray:
        """Of none."""
        return np.zeros(0, dtype=np.int64)


def session_contents(content: MapContent) -> list[tuple[MapContent, int, int]]:
    """Return each session of a map, with the number of its first scan and node in the map."""
    sessions = content.sessions
    if len(sessions) == 1:
        return [(content, 0, 0)]
    scans = ranges([session.first_scan for session in sessions], len(content.stamps))
    nodes = ranges([session.first_node for session in sessions], content.graph.num_nodes)
    return [
        (_session_content(content, session, of_scans, of_nodes), of_scans.start, of_nodes.start)
        for session, of_scans, of_nodes in zip(sessions, scans, nodes, strict=True)
        if of_nodes.stop > of_nodes.start
    ]


def _session_content(
    content: MapContent, session: Session, scans: slice, nodes: slice
) -> SessionContent:
    graph = PoseGraph()
    graph.add_nodes(content.graph.node_poses[nodes])
    return SessionContent(
        content.stamps[scans],
        content.trajectory[scans],
        content.local_trajectory[scans],
        graph,
        content.node_scan_index[nodes] - scans.start,
        content.node_points[nodes],
        (session,),
    )


def events(content: MapContent, find: Callable[[MapContent], list[Event]]) -> list[Event]:
    """Return what `find` finds in each session, with the scans of the map."""
    return [
        event._replace(scan=event.scan + first_scan)
        for session, first_scan, _ in session_contents(content)
        for event in find(session)
    ]


def standing(content: MapContent, find: Callable[[MapContent], list[Standing]]) -> list[Standing]:
    """Return what `find` finds in each session, with the nodes of the map."""
    return [
        each._replace(first=each.first + first_node, last=each.last + first_node)
        for session, _, first_node in session_contents(content)
        for each in find(session)
    ]


def corridors_of(
    content: MapContent, max_range: float, odometry: Mapping[str, Any] | None
) -> Corridors:
    """Return the corridors of all sessions, with the nodes of the map, see :func:`corridors`."""
    parts = [
        (corridors(session, max_range, odometry), first_node)
        for session, _, first_node in session_contents(content)
    ]
    if not parts:
        none = np.zeros(0, dtype=bool)
        return Corridors(np.zeros(0, np.int64), none, none, np.zeros(0))
    return Corridors(
        np.concatenate([found.nodes + first_node for found, first_node in parts]),
        np.concatenate([found.is_corridor for found, _ in parts]),
        np.concatenate([found.is_by_chords for found, _ in parts]),
        np.concatenate([found.gains for found, _ in parts]),
    )


def paths_apart(paths: FloatArray, sessions: Sequence[Session]) -> FloatArray:
    """Return path lengths of nodes with a gap of :data:`APART_M` between sessions, shape (n,).

    Parameters
    ----------
    paths : length of the path from the first node to each [m].
    """
    apart = paths.copy()
    for session in sessions[1:]:
        apart[session.first_node :] += APART_M
    return apart


def same_part(content: MapContent) -> Callable[[int], BoolArray] | None:
    """Return which nodes are in the part of a submap; None where there is one part only."""
    if len({session.part for session in content.sessions}) < 2:
        return None
    node_parts, submap_parts = content.node_parts, content.submap_parts

    def nodes_of(submap: int) -> BoolArray:
        of_part: BoolArray = node_parts == submap_parts[submap]
        return of_part

    return nodes_of
