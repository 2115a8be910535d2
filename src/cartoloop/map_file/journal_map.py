# SPDX-License-Identifier: Apache-2.0
"""The journal of a run that was interrupted, or goes on, as the map that it had so far.

Nodes, finished submaps and closures are as they were. Poses follow from the last adjustment and
from another one here. The submaps that were not finished are made again of the points that their
nodes keep, so they are a little sparser than they were.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import Config, SubmapConfig
from cartoloop.global_slam.closure_matches import SearchMatches
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.closures import Closures
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
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust
from cartoloop.global_slam.pose_graph import ClosureConstraints, ConstraintKind, PoseGraph
from cartoloop.global_slam.trajectory import optimized_trajectory, path_length
from cartoloop.journal.frames import Kind, Record
from cartoloop.map_data import MapData
from cartoloop.map_file.damage import damage_reported, require_cells_to_fit
from cartoloop.map_file.run_header import RunHeader, read_journal
from cartoloop.plain_text import plain_values
from cartoloop.report import InputSummary, Report, summarize_constraints
from cartoloop.sensor.pose import Pose, compose, inverse, relative, transform_points
from cartoloop.session import whole_map
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.node_records import NodeRecord, ScanRecord, recorded_node, recorded_scan
from cartoloop.submaps.probability_grid import ProbabilityGrid, insert_cells, scan_cells


def read_journal_map(path: Path) -> MapData:
    """Return the map in a journal, as far as it goes.

    Raises
    ------
    InputError
        It cannot be read, is damaged, or is of a newer program.
    """
    header, content = read_journal(path)
    with damage_reported(path):
        collected = _Collected(content.size, header)
        for record in content.records:
            if not (header.continues and record.kind in _OF_THE_WHOLE):
                collected.add(record)
        return _map_of(collected, header)


_OF_THE_WHOLE = frozenset(
    {
        Kind.REQUESTS,
        Kind.DROPPED,
        Kind.SEARCHED,
        Kind.WIDE_SEARCHED,
        Kind.BELIEVED,
        Kind.POSES,
    }
)
"""Records about the map that a run continues, too. Without that they cannot be read: the session is
left as local SLAM saw it, and finds its closures when it is joined to the map again."""

_FARTHEST_M = 1e5
"""Farther than any scanner measures [m]."""


class _Collected:
    """The content of the records of a journal.

    Attributes
    ----------
    scans, nodes : as recorded; `node_scans`: which scan each node is.
    origins : of each submap [m, local frame].
    grids : of the finished submaps.
    closures : the record.
    found : closures that joined the graph, and whether no loss weakens them.
    submap_poses : as adjusted last, of the submaps that there were then.
    calibration : what was learnt about the sensors.
    """

    def __init__(self, num_bytes: int, header: RunHeader) -> None:
        self.num_bytes = num_bytes
        self._first_node, self._first_submap = header.first_node, header.first_submap
        self.scans: list[ScanRecord] = []
        self.nodes: list[NodeRecord] = []
        self.node_scans: list[int] = []
        self.origins: list[Pose] = []
        self.grids: dict[int, FinishedGrid] = {}
        self.num_cells = 0
        self.closures = Closures()
        self.found: list[tuple[SearchMatches, bool]] = []
        self.submap_poses: FloatArray = np.zeros((0, 3))
        self.calibration: dict[str, object] = {}
        self._node: NodeRecord | None = None

    def add(self, record: Record) -> None:
        """Add the content of the next record."""
        kind, payload = record
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
            self.submap_poses = recorded_poses(payload)
        elif kind in (Kind.REQUESTS, Kind.DROPPED):
            self._add_requests(kind, payload)
        elif kind in (Kind.SEARCHED, Kind.WIDE_SEARCHED, Kind.BELIEVED):
            self._add_outcomes(kind, payload)

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
        self._check(requests.submap, len(self.origins))
        self._check(requests.node_submap, len(self.origins))
        self._check(requests.node, len(self.nodes))
        self.closures.request(requests, num_nodes)

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
        self.closures.add_found(matches, len(self.nodes))
        self.found.append((matches, is_trusted))

    def _rows(self, rows: np.ndarray) -> np.ndarray:
        self._check(rows, len(self.closures))
        return rows

    @staticmethod
    def _check(indices: np.ndarray, end: int) -> None:
        if np.any((indices < 0) | (indices >= end)):
            raise ValueError("a closure is of no submap, node or request")


def _map_of(collected: _Collected, header: RunHeader) -> MapData:
    config, closures = header.config, collected.closures
    graph = _graph(collected, config)
    node_scans = np.array(collected.node_scans, dtype=np.int64)
    stamps = np.array([scan.stamp for scan in collected.scans])
    local = np.array([scan.tf_local_tracking for scan in collected.scans]).reshape(-1, 3)
    trajectory = optimized_trajectory(local, node_scans, graph.node_poses)
    duration = float(np.ptp(stamps)) if len(stamps) else 0.0
    report = Report(
        input=InputSummary(header.name, len(stamps), duration, path_length(trajectory)),
        nodes=graph.num_nodes,
        submaps=graph.num_submaps,
        constraints=summarize_constraints(graph, closures),
        version=header.program,
        fingerprint=header.fingerprint,
        extra=closures.summary(),
    )
    [session] = whole_map(header.name, header.fingerprint, stamps)
    return MapData(
        stamps=stamps,
        trajectory=trajectory,
        local_trajectory=local,
        graph=graph,
        node_scan_index=node_scans,
        submap_grids=_grids(collected, config.local_slam.submaps),
        config=config,
        report=report,
        closures=closures,
        node_points=[node.points for node in collected.nodes],
        sessions=(replace(session, calibration=collected.calibration),),
    )


def _graph(collected: _Collected, config: Config) -> PoseGraph:
    """Return the adjusted graph."""
    graph, options = PoseGraph(), config.global_slam.pose_adjustment
    poses = _submap_poses(collected)
    graph.add_submaps(np.array(poses))
    if graph.num_submaps:
        graph.fix_submap(0)
    for node in collected.nodes:
        inside = [
            relative(collected.origins[index], node.tf_local_tracking) for index, *_ in node.submaps
        ]
        oldest = node.submaps[0][0]
        graph.add_nodes(compose(poses[oldest], inside[0]))
        graph.add_constraints(
            ConstraintKind.INTRA_SUBMAP,
            [index for index, *_ in node.submaps],
            [node.number for _ in node.submaps],
            inside,
            [options.intra_submap_weight * node.information for _ in node.submaps],
        )
    closures = collected.closures
    for found, is_trusted in collected.found:
        submap, node_of = closures.submap[found.row], closures.node[found.row]
        constraints = ClosureConstraints(
            found.row, submap, node_of, found.tf_submap_node, found.information
        )
        graph.add_loop_closures(constraints, are_trusted=is_trusted)
    if collected.found:
        adjust(
            graph,
            AdjustmentOptions(
                loss=options.loss,
                loss_scale=options.loss_scale,
                max_iterations=options.max_num_final_iterations,
                relative_tolerance=options.tolerance,
            ),
        )
    return graph


def _submap_poses(collected: _Collected) -> list[Pose]:
    """Return the poses of all submaps: as adjusted last, and continued in the local frame."""
    if not np.isfinite(collected.submap_poses).all():
        raise ValueError("a pose is not finite")
    count = min(len(collected.submap_poses), len(collected.origins))
    poses = [Pose(*pose) for pose in collected.submap_poses[:count].tolist()]
    tf_map_local = Pose(0.0, 0.0, 0.0)
    if poses:
        tf_map_local = compose(poses[-1], inverse(collected.origins[count - 1]))
    return poses + [compose(tf_map_local, origin) for origin in collected.origins[count:]]


def _grids(collected: _Collected, config: SubmapConfig) -> list[FinishedGrid]:
    """Return the grids of all submaps."""
    grids = []
    for index in range(len(collected.origins)):
        grid = collected.grids.get(index)
        grids.append(_unfinished(index, collected, config) if grid is None else grid)
    return grids


def _unfinished(index: int, collected: _Collected, config: SubmapConfig) -> FinishedGrid:
    """Return the grid of a submap that was not finished, made of the points of its nodes."""
    r, tf_local_submap = config.resolution, collected.origins[index]
    lattice = round(tf_local_submap.x / r), round(tf_local_submap.y / r)
    grid = ProbabilityGrid(r)
    nothing = np.zeros((0, 2))
    for node in collected.nodes:
        if all(number != index for number, *_ in node.submaps):
            continue
        pose = node.tf_local_tracking
        x, y = node.origin.tolist()
        cells = scan_cells(
            compose(pose, Pose(x, y, 0.0)), transform_points(pose, node.points), nothing, r
        )
        before = grid.cells.size
        insert_cells(grid, cells, config, lattice)
        collected.count_cells(grid.cells.size - before)
    return grid.finish()
