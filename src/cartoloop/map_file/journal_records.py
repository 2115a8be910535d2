# SPDX-License-Identifier: Apache-2.0
"""The records of a journal, collected and checked."""

from __future__ import annotations

import json

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.graph_records import (
    cells_of_submap,
    index_of_submap,
    recorded_matches,
    recorded_outcomes,
    recorded_poses,
    recorded_requests,
    recorded_rows,
    recorded_submap,
    recorded_wide_outcomes,
)
from cartoloop.global_slam.join_records import (
    recorded_join_decision,
    recorded_join_searches,
    with_rows,
)
from cartoloop.global_slam.loading import Loaded, load
from cartoloop.global_slam.sessions import MappedSessions
from cartoloop.journal.frames import Kind, Record
from cartoloop.map_file.damage import require_cells_to_fit
from cartoloop.map_file.run_header import RunHeader
from cartoloop.plain_text import plain_values
from cartoloop.sensor.pose import IDENTITY, Pose, compose, compose_all, inverse
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.node_records import NodeRecord, ScanRecord, recorded_node, recorded_scan

_OF_THE_WHOLE = frozenset(
    {
        Kind.REQUESTS,
        Kind.DROPPED,
        Kind.SEARCHED,
        Kind.WIDE_SEARCHED,
        Kind.BELIEVED,
        Kind.POSES,
        Kind.JOIN_SEARCHED,
        Kind.JOIN_DECIDED,
    }
)
"""Records about the map that a run continues, too. Without that they cannot be read: the session is
left as local SLAM saw it, and finds its closures when it is joined to the map again."""

_FARTHEST_M = 1e5
"""Farther than any scanner measures [m]."""


class JournalRecords:
    """The content of the records of a journal.

    Parameters
    ----------
    num_bytes : size of the journal.
    header : of it.
    mapped : the map that the run adds a session to, if it does, and if that is known.

    Attributes
    ----------
    scans, nodes : of the run, as recorded; numbers count from its own first ones. `node_scans`:
        which of the scans each node is.
    origins : of each submap of the run [m, local frame].
    grids : of its finished submaps, by number.
    loaded : graph, record of closures and sessions: those of the map before, and the run's.
    found : closures that joined the graph, and whether no loss weakens them.
    calibration : what was learnt about the sensors.
    """

    def __init__(
        self, num_bytes: int, header: RunHeader, mapped: MappedSessions | None = None
    ) -> None:
        self.num_bytes = num_bytes
        self._first_node, self._first_submap = header.first_node, header.first_submap
        self._knows_all = mapped is not None or not header.continues
        self.loaded: Loaded = load([] if mapped is None else [mapped])
        graph = self.loaded.graph
        self.num_nodes_before, self.num_submaps_before = graph.num_nodes, graph.num_submaps
        self.part = self.loaded.ranges.begin(graph.num_nodes, graph.num_submaps)
        self.scans: list[ScanRecord] = []
        self.nodes: list[NodeRecord] = []
        self.node_scans: list[int] = []
        self.origins: list[Pose] = []
        self.grids: dict[int, FinishedGrid] = {}
        self.num_cells = 0
        self.closures = self.loaded.closures
        self.found: list[tuple[SearchMatches, bool]] = []
        self._submap_poses: FloatArray = graph.submap_poses.copy()
        self.calibration: dict[str, object] = {}
        self._node: NodeRecord | None = None

    def add(self, record: Record) -> None:
        """Add the content of the next record."""
        kind, payload = record
        if kind in _OF_THE_WHOLE and not self._knows_all:
            return
        if kind == Kind.SCAN:
            self._add_scan(recorded_scan(payload))
        elif kind == Kind.NODE:
            self._node = recorded_node(payload).counted_from(self._first_node, self._first_submap)
        elif kind == Kind.CALIBRATION:
            self.calibration = plain_values(json.loads(bytes(payload))) or {}
        elif kind == Kind.SUBMAP:
            self.count_cells(cells_of_submap(payload))
            index = index_of_submap(payload) - self._first_submap
            self.grids[index] = recorded_submap(payload)[0]
        elif kind == Kind.POSES:
            self._set_poses(recorded_poses(payload))
        elif kind in (Kind.REQUESTS, Kind.DROPPED):
            self._add_requests(kind, payload)
        elif kind in (Kind.SEARCHED, Kind.WIDE_SEARCHED, Kind.BELIEVED):
            self._add_outcomes(kind, payload)
        elif kind == Kind.JOIN_SEARCHED:
            self._add_join_searches(payload)
        elif kind == Kind.JOIN_DECIDED:
            self._add_join(payload)

    def count_cells(self, num_cells: int) -> None:
        """Count the cells of a submap; raise ValueError if they are too many for the file."""
        self.num_cells += num_cells
        require_cells_to_fit(self.num_cells, self.num_bytes)

    def _add_scan(self, scan: ScanRecord) -> None:
        node, self._node = self._node, None
        if not np.isfinite((scan.stamp, *scan.tf_local_tracking)).all():
            raise ValueError("a pose is not finite")
        if node is not None:
            self._add_node(node)
        self.scans.append(scan)

    def _add_node(self, node: NodeRecord) -> None:
        numbers = (*node.tf_local_tracking, *node.origin, *node.information.ravel())
        is_far = np.abs(node.points).max(initial=0.0) > _FARTHEST_M
        if node.number != len(self.nodes) or is_far or not np.isfinite(numbers).all():
            raise ValueError(f"node {len(self.nodes)} is damaged")
        for index, x, y in node.submaps:
            if not 0 <= index <= len(self.origins) or not np.isfinite((x, y)).all():
                raise ValueError(f"submap {index} is damaged")
            if index == len(self.origins):
                self.origins.append(Pose(x, y, 0.0))
        if not node.submaps:
            raise ValueError(f"node {node.number} is in no submap")
        self.nodes.append(node)
        self.node_scans.append(len(self.scans))

    def _add_requests(self, kind: int, payload: memoryview) -> None:
        if kind == Kind.DROPPED:
            self.closures.note_dropped(self._rows(recorded_rows(payload)))
            return
        requests, num_nodes = recorded_requests(payload)
        # Global SLAM requests pairs of nodes that were recorded before.
        self._check_requests(requests)
        self.closures.request(requests, num_nodes)

    def _check_requests(self, requests: Requests) -> None:
        num_submaps = self.num_submaps_before + len(self.origins)
        self._check(requests.submap, num_submaps)
        self._check(requests.node_submap, num_submaps)
        self._check(requests.node, self.num_nodes_before + len(self.nodes))

    def _add_join_searches(self, payload: memoryview) -> None:
        for each in recorded_join_searches(payload):
            self._check_requests(each.requests)
            num_nodes = self.num_nodes_before + len(self.nodes)
            rows = self.closures.request(each.requests, num_nodes)
            self.closures.note_searched(rows, each.min_score)
            self.closures.note_hypotheses(rows)

    def _add_join(self, payload: memoryview) -> None:
        """Place one part where it was joined to another."""
        decision, ranges = recorded_join_decision(payload), self.loaded.ranges
        if not decision.is_joined:
            return
        if not {decision.one, decision.other} <= set(ranges.parts):
            raise ValueError("a join is of no part of the map")
        poses = self.submap_poses
        is_moved = ranges.of_submaps(len(poses)) == decision.other
        poses[is_moved] = compose_all(np.array(decision.tf_one_other), poses[is_moved])
        self._submap_poses = poses
        ranges.join(decision.other, decision.one)
        self._add_found(decision.found, is_trusted=True)
        self._check_requests(decision.nearby.requests)
        num_nodes = self.num_nodes_before + len(self.nodes)
        nearby = with_rows(decision.nearby, self.closures, num_nodes)
        self._add_found(nearby, is_trusted=False)

    @property
    def submap_poses(self) -> FloatArray:
        """Poses of all submaps, shape (n, 3): as adjusted last, continued in the local frame."""
        known = self._submap_poses
        new = self.origins[len(known) - self.num_submaps_before :]
        if not new:
            return known.copy()
        tf_map_local = IDENTITY
        if len(known) > self.num_submaps_before:
            last = self.origins[len(known) - 1 - self.num_submaps_before]
            tf_map_local = compose(Pose(*known[-1].tolist()), inverse(last))
        return np.concatenate((known, [compose(tf_map_local, origin) for origin in new]))

    def _set_poses(self, poses: FloatArray) -> None:
        if not np.isfinite(poses).all():
            raise ValueError("a pose is not finite")
        if len(poses) < self.num_submaps_before:
            raise ValueError("poses of submaps are missing")
        count = self.num_submaps_before + len(self.origins)
        self._submap_poses = poses[:count]

    def _add_outcomes(self, kind: int, payload: memoryview) -> None:
        closures = self.closures
        if kind == Kind.BELIEVED:
            self._add_found(recorded_matches(payload), is_trusted=True)
        elif kind == Kind.WIDE_SEARCHED:
            for wide in recorded_wide_outcomes(payload)[1]:
                closures.note_searched(self._rows(wide.rows), wide.min_score)
                matched = np.array([each.row for each in wide.candidates], dtype=np.int32)
                closures.note_hypotheses(self._rows(matched))
        else:
            for outcome in recorded_outcomes(payload)[1]:
                closures.note_searched(self._rows(outcome.searched), outcome.min_score)
                closures.note_ambiguous(self._rows(outcome.ambiguous))
                reason = Reason.EMPTY_SUBMAP if outcome.is_empty else Reason.ENOUGH_CLOSURES
                closures.note_not_searched(self._rows(outcome.not_searched), reason)
                if len(outcome.matches.row):
                    self._add_found(outcome.matches, is_trusted=False)

    def _add_found(self, matches: SearchMatches, *, is_trusted: bool) -> None:
        self._rows(matches.row)
        if not all(np.isfinite(column).all() for column in matches):
            raise ValueError("a match is not finite")
        self.closures.add_found(matches, self.num_nodes_before + len(self.nodes))
        self.found.append((matches, is_trusted))

    def _rows(self, rows: np.ndarray) -> np.ndarray:
        self._check(rows, len(self.closures))
        return rows

    @staticmethod
    def _check(indices: np.ndarray, end: int) -> None:
        if np.any((indices < 0) | (indices >= end)):
            raise ValueError("a closure is of no submap, node or request")
