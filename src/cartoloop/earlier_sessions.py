# SPDX-License-Identifier: Apache-2.0
"""The scans and sessions of maps that mapping goes on from, one map after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.errors import UsageError
from cartoloop.global_slam.sessions import MappedSessions, SessionRanges
from cartoloop.global_slam.trajectory import optimized_trajectory
from cartoloop.map_data import MapData
from cartoloop.report import InputSummary
from cartoloop.session import Session, ranges


class EarlierMaps:
    """The scans and sessions of maps, as the beginning of one that goes on.

    Parameters
    ----------
    maps : in order; none for a new map.

    Attributes
    ----------
    maps : as given.
    stamps, local_poses : of all scans, shapes (n,), (n, 3).
    node_scan_index : scan of each node, int64, shape (k,).
    num_submaps : of all maps.
    sessions : of all maps, with their places in the whole; the parts are those of each map.
    """

    def __init__(self, maps: Sequence[MapData] = ()) -> None:
        self.maps = maps
        self.stamps: FloatArray = np.concatenate([np.zeros(0), *(each.stamps for each in maps)])
        self.local_poses: FloatArray = np.concatenate(
            [np.zeros((0, 3)), *(each.local_trajectory for each in maps)]
        )
        self.sessions: list[Session] = []
        scans: list[NDArray[np.int64]] = []
        first_scan = first_node = first_submap = 0
        for each in maps:
            scans.append(each.node_scan_index + first_scan)
            self.sessions += [
                replace(
                    session,
                    first_scan=session.first_scan + first_scan,
                    first_node=session.first_node + first_node,
                    first_submap=session.first_submap + first_submap,
                )
                for session in each.sessions
            ]
            first_scan += len(each.stamps)
            first_node += each.graph.num_nodes
            first_submap += each.graph.num_submaps
        self.num_submaps = first_submap
        self.node_scan_index: NDArray[np.int64] = np.concatenate([np.zeros(0, np.int64), *scans])

    @property
    def mapped(self) -> list[MappedSessions]:
        """The maps as global SLAM takes them.

        Raises
        ------
        UsageError
            A map has no scans of its nodes, so that mapping cannot go on from it.
        """
        return [_mapped(each) for each in self.maps]

    def summary(self, own: InputSummary) -> InputSummary:
        """Return what was mapped in all, given the summary of the session that is mapped."""
        all_of = [*(each.report.input for each in self.maps), own]
        return replace(
            own,
            scans=sum(each.scans for each in all_of),
            duration_s=sum(each.duration_s for each in all_of),
            path_length_m=sum(each.path_length_m for each in all_of),
        )

    def skipped(self, own: Mapping[str, int]) -> dict[str, int]:
        """Return what was skipped in all, by reason, given that of the session that is mapped."""
        total = dict(own)
        for each in self.maps:
            for reason, count in each.report.skipped.items():
                total[reason] = total.get(reason, 0) + count
        return dict(sorted(total.items()))


def _mapped(content: MapData) -> MappedSessions:
    if len(content.node_points) < content.graph.num_nodes:
        raise UsageError(
            "a map that is added to has no returns of its nodes, so that nothing can be found in "
            "it; map the recording again"
        )
    return MappedSessions(
        content.sessions,
        content.graph,
        content.submap_grids,
        content.node_points,
        content.local_trajectory[content.node_scan_index],
        content.closures,
    )


def with_parts(sessions: Sequence[Session], parts: SessionRanges) -> tuple[Session, ...]:
    """Return sessions with the parts that they belong to by now, counted from 0 on."""
    numbers: dict[int, int] = {}
    for part in parts.parts:
        numbers.setdefault(part, len(numbers))
    return tuple(
        replace(session, part=numbers[part])
        for session, part in zip(sessions, parts.parts, strict=True)
    )


def whole_trajectory(
    sessions: Sequence[Session],
    local: FloatArray,
    node_scan_index: NDArray[np.int64],
    node_poses: FloatArray,
) -> FloatArray:
    """Return tf_map_tracking of each scan, interpolated within its session, shape (n, 3).

    Parameters
    ----------
    sessions : of the map.
    local, node_scan_index, node_poses : as of `optimized_trajectory`.
    """
    scans = ranges([session.first_scan for session in sessions], len(local))
    nodes = ranges([session.first_node for session in sessions], len(node_scan_index))
    parts = [
        optimized_trajectory(
            local[of_scans], node_scan_index[of_nodes] - of_scans.start, node_poses[of_nodes]
        )
        for of_scans, of_nodes in zip(scans, nodes, strict=True)
    ]
    return np.concatenate(parts)
