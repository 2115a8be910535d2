# SPDX-License-Identifier: Apache-2.0
"""The sessions of a map: split, renamed, and what is left of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.global_slam.trajectory import optimized_trajectory
from cartoloop.map_data import MapData
from cartoloop.map_editing.removal import Kept
from cartoloop.session import MAIN_PART, Session, ranges


def session_of(sessions: Sequence[Session], scan: int) -> int:
    """Return the number of the session that a scan belongs to."""
    firsts = [session.first_scan for session in sessions]
    return max(int(np.searchsorted(firsts, scan, side="right")) - 1, 0)


def split(
    original: MapData, sessions: Sequence[Session], scan: int, name: str
) -> tuple[Session, ...]:
    """Return sessions with that of a scan split before it, unless it begins there.

    A submap belongs to the session of the first node that was inserted into it.
    """
    number = session_of(sessions, scan)
    before = sessions[number]
    if before.first_scan == scan:
        return tuple(sessions)
    first_node = int(np.searchsorted(original.node_scan_index, scan))
    second = replace(
        before,
        name=name,
        first_scan=scan,
        first_node=first_node,
        first_submap=max(_first_submap(original.graph, first_node), before.first_submap),
        stamp=float(original.stamps[scan]),
    )
    return (*sessions[: number + 1], second, *sessions[number + 1 :])


def renamed(sessions: Sequence[Session], scan: int, name: str) -> tuple[Session, ...]:
    """Return sessions with another name for that which begins with a scan, if there is one."""
    number = session_of(sessions, scan)
    if sessions[number].first_scan != scan:
        return tuple(sessions)
    others = list(sessions)
    others[number] = replace(others[number], name=name)
    return tuple(others)


def joined(sessions: Sequence[Session], part: int, to: int) -> tuple[Session, ...]:
    """Return sessions with those of one part moved to another."""
    return tuple(
        replace(session, part=to) if session.part == part else session for session in sessions
    )


def sessions_left(
    sessions: Sequence[Session], kept: Kept, stamps: FloatArray
) -> tuple[tuple[Session, ...], tuple[int, ...]]:
    """Return the sessions of what is left, and the first scan that each had before.

    Those that lost all their scans are left out.

    Parameters
    ----------
    stamps : of the scans that are left.
    """
    firsts = [session.first_scan for session in sessions]
    scans = np.searchsorted(kept.scans, firsts)
    nodes = np.searchsorted(kept.nodes, [session.first_node for session in sessions])
    submaps = np.searchsorted(kept.submaps, [session.first_submap for session in sessions])
    ends = [*scans[1:].tolist(), len(kept.scans)]
    left, begins, first_submap = [], [], 0
    for number, session in enumerate(sessions):
        if scans[number] == ends[number]:
            continue
        moved = replace(
            session,
            first_scan=int(scans[number]),
            first_node=int(nodes[number]),
            first_submap=first_submap,
            stamp=float(stamps[scans[number]]),
        )
        left.append(moved)
        begins.append(firsts[number])
        # What is left of the submaps of a session that is left out was made by the next one.
        first_submap = int(submaps[number + 1]) if number + 1 < len(sessions) else 0
    return (tuple(left), tuple(begins)) if left else ((Session(),), (0,))


def trajectory_of(original: MapData, node_poses: FloatArray) -> FloatArray:
    """Return tf_map_tracking of each scan of a map as mapped, for other poses of its nodes."""
    sessions, local = original.sessions, original.local_trajectory
    scans = ranges([session.first_scan for session in sessions], len(local))
    nodes = ranges([session.first_node for session in sessions], len(node_poses))
    parts = [
        optimized_trajectory(
            local[of_scans],
            original.node_scan_index[of_nodes] - (of_scans.start or 0),
            node_poses[of_nodes],
        )
        for of_scans, of_nodes in zip(scans, nodes, strict=True)
    ]
    return np.concatenate(parts)


def main_part(original: MapData, sessions: Sequence[Session]) -> tuple[IntArray, IntArray]:
    """Return the submaps and the nodes of the part of a map that is drawn."""
    placed = replace(original, sessions=tuple(sessions))
    return (
        np.flatnonzero(placed.submap_parts == MAIN_PART),
        np.flatnonzero(placed.node_parts == MAIN_PART),
    )


def _first_submap(graph: PoseGraph, first_node: int) -> int:
    """Return the first submap whose nodes all come from `first_node` on."""
    own = graph.kinds == ConstraintKind.INTRA_SUBMAP
    first = np.full(graph.num_submaps, graph.num_nodes)
    np.minimum.at(first, graph.index_a[own], graph.index_b[own])
    before = np.flatnonzero(first < first_node)
    return int(before[-1]) + 1 if len(before) else 0
