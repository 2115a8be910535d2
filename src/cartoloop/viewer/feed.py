# SPDX-License-Identifier: Apache-2.0
"""Updates from the mapping thread to the viewer: references and small copies, one at a time.

There is room for one update. While it has not been taken, a scan costs the mapping thread one
comparison; the next scan after it was taken makes another, of all that has changed since. So the
viewer gets the latest state as often as it can use it, and mapping never waits for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.global_slam.closure_status import Status
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.quality.verdict import Quality
from cartoloop.sensor.pose import IDENTITY, Pose, compose, compose_all, inverse, relative_all
from cartoloop.session import Session, ranges
from cartoloop.viewer.beside import (
    GROWING_STEP_M,
    Box,
    Placed,
    beside,
    moved,
    part_offsets,
)
from cartoloop.viewer.protocol import REJECTED, ConstraintRows

if TYPE_CHECKING:
    from cartoloop.global_slam.graph_adjustment import AdjustmentRun
    from cartoloop.mapper import Mapper
    from cartoloop.result import Result
    from cartoloop.scan_matching.least_squares import LeastSquaresMatch
    from cartoloop.submaps.finished_grid import FinishedGrid
    from cartoloop.submaps.submap import Submap

_NO_POINTS = np.zeros((0, 2))


class GrowingCells(NamedTuple):
    """The grid of a submap that still grows.

    Attributes
    ----------
    submap : its number.
    cells : float32, shape (rows, cols), probabilities, 0 where never observed. The mapper's
        own array: while it is read, scans may be inserted, so that some cells are newer.
    origin_x, origin_y : centre of ``cells[0, 0]`` [m, submap frame].
    resolution : edge of a cell [m].
    """

    submap: int
    cells: NDArray[np.float32]
    origin_x: float
    origin_y: float
    resolution: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        rows, cols = self.cells.shape
        return rows, cols


def constraints_of(graph: PoseGraph, first: int = 0) -> ConstraintRows:
    """Return the constraints from row `first` on; they are never written to again."""
    return ConstraintRows(
        graph.index_a[first:],
        graph.index_b[first:],
        graph.relative_poses[first:],
        graph.kinds[first:],
        graph.closure_rows[first:],
    )


def rejected_closures(closures: Closures) -> ConstraintRows:
    """Return the closures that are not in the finished graph although they were in it before.

    Those that the last pass rejects have the pose that the search measured, those that the other
    constraints contradict, or that an edit removed, the pose that the last pass measured.
    """
    found = closures.found
    contradicted = closures.with_status(Status.CONTRADICTED, Status.REMOVED)
    status = closures.status[found.row]
    lost = (status == Status.POOR_FIT) | (status == Status.MOVED_TOO_FAR)
    rows = np.concatenate((found.row[lost], contradicted.row))
    return ConstraintRows(
        closures.submap[rows],
        closures.node[rows],
        np.concatenate((found.tf_submap_node[lost], contradicted.tf_submap_node)),
        np.full(len(rows), REJECTED),
        rows,
    )


class PosesBefore(NamedTuple):
    """Where submaps and nodes would be without loop closure, float64 (m, 3), (n, 3) [map]."""

    tf_map_submaps: FloatArray
    tf_map_nodes: FloatArray


def poses_before(result: Result, placed: Placed | None = None) -> PosesBefore:
    """Return the poses of local SLAM, the first node of each session being where it is in the map.

    Parameters
    ----------
    result : the map.
    placed : where it is drawn; None: where it is.
    """
    graph, placed = result.graph, placed or beside(result)
    submaps, nodes = placed.submap_poses.copy(), placed.node_poses.copy()
    if graph.num_nodes == 0:
        return PosesBefore(submaps, nodes)
    local = result.local_trajectory[result.node_scan_index]
    for some in ranges([session.first_node for session in result.sessions], len(nodes)):
        if len(local[some]):
            begin = Pose(*nodes[some][0].tolist())
            tf_map_local = compose(begin, inverse(Pose(*local[some][0].tolist())))
            nodes[some] = compose_all(np.array(tf_map_local), local[some])
    own = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
    found, first = np.unique(graph.index_a[own], return_index=True)
    rows = own[first]
    tf_node_submap = relative_all(graph.relative_poses[rows], np.zeros(3))
    submaps[found] = compose_all(nodes[graph.index_b[rows]], tf_node_submap)
    return PosesBefore(submaps, nodes)


@dataclass(frozen=True, slots=True)
class Update:
    """What has changed since the update before, and the newest of what always does.

    Attributes
    ----------
    submap_poses : float64 (m, 3), of all submaps.
    first_node, node_poses, node_stamps : rows of the nodes from `first_node` on: all of them if
        poses were adjusted, otherwise the new ones. The stamps: of the new ones, always.
    adjusted : whether poses of before have changed.
    first_constraint, constraints : rows from there on; 0 if all are to be replaced.
    finished : grids of submaps that were finished, by number.
    active : the submaps that still grow.
    closures : the record of closures; the mapper's own.
    node_points : of each node the returns that are matched with submaps.
    num_found : closures that searches found so far.
    rejected : closures that are not in the finished graph; None while mapping.
    quality : the verdict on the finished map; None while mapping.
    before : the poses before loop closure; None while mapping.
    sessions : of a finished map, or one that a session is added to; none otherwise.
    submap_parts, node_parts : part of each submap and node of such a map; None otherwise.
    match : of the last scan to the map, None where it was not matched.
    last_information : inverse covariance of the last scan's pose, None unless it became a node.
    time : when this was [s, perf_counter].
    """

    submap_poses: FloatArray
    first_node: int
    node_poses: FloatArray
    node_stamps: FloatArray
    adjusted: bool
    first_constraint: int
    constraints: ConstraintRows
    finished: dict[int, FinishedGrid]
    active: tuple[GrowingCells, ...] = ()
    closures: Closures = field(default_factory=Closures)
    num_found: int = 0
    node_points: Sequence[FloatArray] = ()
    rejected: ConstraintRows | None = None
    quality: Quality | None = None
    before: PosesBefore | None = None
    sessions: tuple[Session, ...] = ()
    submap_parts: IntArray | None = None
    node_parts: IntArray | None = None
    stamp: float = 0.0
    recorded_s: float = 0.0
    num_scans: int = 0
    pose: Pose = IDENTITY
    returns: FloatArray = field(default_factory=lambda: _NO_POINTS)
    match: LeastSquaresMatch | None = None
    last_information: FloatArray | None = None
    tf_map_local: Pose = IDENTITY
    backlog: int = 0
    num_adjustments: int = 0
    last_adjustment: AdjustmentRun | None = None
    skipped: dict[str, int] = field(default_factory=dict)
    time: float = 0.0


class Feed:
    """Gathers updates in the mapping thread, for one taker in another thread."""

    def __init__(self) -> None:
        self._ready: Update | None = None
        self._revision = 0
        self._num_scans = 0
        self._num_nodes = 0
        self._num_constraints = 0
        self._num_adjustments = 0
        self._finished: set[int] = set()
        self._offsets: dict[int, FloatArray] = {}

    def after_event(self, mapper: Mapper) -> None:
        """Lay down an update if the one before was taken; to be called in the mapping thread."""
        if self._ready is None and mapper.num_scans != self._num_scans and mapper.last_scan:
            self._num_scans = mapper.num_scans
            self._ready = self.update(mapper)

    def _placed(
        self, mapper: Mapper, grids: Mapping[int, FinishedGrid], active: Sequence[GrowingCells]
    ) -> _Placed:
        """Return where the parts of the map are drawn: those that are apart beside the main one."""
        slam, pose = mapper.global_slam, mapper.pose
        graph = slam.graph
        if len(slam.sessions) == 1:
            return _Placed(graph.submap_poses.copy(), graph.node_poses, pose)
        submap_parts = slam.sessions.of_submaps(graph.num_submaps)
        node_parts = slam.sessions.of_nodes(graph.num_nodes)
        before, self._offsets = self._offsets, {}
        if len(set(slam.sessions.parts)) > 1:
            boxes: dict[int, Box] = {**grids, **{each.submap: each for each in active}}
            boxes = {index: box for index, box in boxes.items() if index < graph.num_submaps}
            self._offsets = part_offsets(graph.submap_poses, boxes, submap_parts, GROWING_STEP_M)
        dx, dy = self._offsets.get(slam.sessions.parts[-1], np.zeros(2)).tolist()
        has_moved = {part: tuple(offset) for part, offset in before.items() if offset.any()} != {
            part: tuple(offset) for part, offset in self._offsets.items() if offset.any()
        }
        return _Placed(
            moved(graph.submap_poses, submap_parts, self._offsets),
            moved(graph.node_poses, node_parts, self._offsets),
            Pose(pose.x + dx, pose.y + dy, pose.theta),
            has_moved,
            mapper.sessions,
            submap_parts,
            node_parts,
        )

    def take(self) -> Update | None:
        """Return the update that is ready, if any; to be called in the viewer's thread."""
        update = self._ready
        if update is not None:
            self._ready = None
        return update

    def update(self, mapper: Mapper) -> Update:
        """Return what has changed since the update before, which must be taken in first."""
        slam, last = mapper.global_slam, mapper.last_scan
        assert last is not None
        graph, runs = slam.graph, slam.adjustments
        if graph.revision != self._revision:  # constraints were removed or replaced
            self._revision, self._num_constraints = graph.revision, 0
        grids = slam.finished_grids()
        new = grids.keys() - self._finished
        active = _growing(mapper.active_submaps, grids)
        placed = self._placed(mapper, grids, active)
        adjusted = len(runs) != self._num_adjustments or placed.has_moved
        first_node = 0 if adjusted else self._num_nodes
        update = Update(
            submap_poses=placed.submap_poses,
            first_node=first_node,
            node_poses=placed.node_poses[first_node:].copy(),
            node_stamps=mapper.node_stamps(self._num_nodes),
            adjusted=adjusted,
            first_constraint=self._num_constraints,
            constraints=constraints_of(graph, self._num_constraints),
            finished={index: grids[index] for index in sorted(new)},
            active=active,
            closures=slam.closures,
            num_found=slam.closures.num_found,
            node_points=slam.node_points,
            stamp=mapper.last_stamp,
            recorded_s=mapper.recorded_s,
            num_scans=mapper.num_scans,
            sessions=placed.sessions,
            submap_parts=placed.submap_parts,
            node_parts=placed.node_parts,
            pose=placed.pose,
            returns=last.returns,
            match=last.match,
            last_information=last.node.information if last.node else None,
            tf_map_local=slam.tf_map_local,
            backlog=slam.search.backlog,
            num_adjustments=len(runs),
            last_adjustment=runs[-1] if runs else None,
            skipped=dict(mapper.skipped),
            time=perf_counter(),
        )
        self._num_nodes, self._num_adjustments = graph.num_nodes, len(runs)
        self._num_constraints = graph.num_constraints
        self._finished |= new
        return update


class _Placed(NamedTuple):
    """Where the parts of a growing map are drawn; see `Update`.

    Attributes
    ----------
    has_moved : whether a part is drawn elsewhere than in the update before.
    """

    submap_poses: FloatArray
    node_poses: FloatArray
    pose: Pose
    has_moved: bool = False
    sessions: tuple[Session, ...] = ()
    submap_parts: IntArray | None = None
    node_parts: IntArray | None = None


def _growing(
    submaps: Sequence[Submap], finished: Mapping[int, FinishedGrid]
) -> tuple[GrowingCells, ...]:
    return tuple(
        GrowingCells(
            submap.index,
            submap.grid.cells,
            submap.grid.origin_x,
            submap.grid.origin_y,
            submap.grid.resolution,
        )
        for submap in submaps
        if submap.index not in finished
    )


def whole(result: Result) -> Update:
    """Return the update that replaces all by a finished map."""
    graph, report = result.graph, result.report
    runs = report.adjustment.each
    stamps = result.stamps[result.node_scan_index]
    placed = beside(result)
    pose = Pose(*result.trajectory[-1].tolist()) if len(result.trajectory) else IDENTITY
    dx, dy = placed.last_offset
    return Update(
        submap_poses=placed.submap_poses,
        first_node=0,
        node_poses=placed.node_poses,
        node_stamps=stamps,
        adjusted=True,
        first_constraint=0,
        constraints=constraints_of(graph),
        finished=dict(enumerate(result.submap_grids)),
        closures=result.closures,
        num_found=result.closures.num_found,
        node_points=result.node_points,
        rejected=rejected_closures(result.closures),
        quality=report.quality,
        before=poses_before(result, placed),
        sessions=result.sessions,
        submap_parts=result.submap_parts,
        node_parts=result.node_parts,
        stamp=float(result.stamps[-1]) if len(result.stamps) else 0.0,
        recorded_s=report.input.duration_s,
        num_scans=report.input.scans,
        pose=Pose(pose.x + dx, pose.y + dy, pose.theta),
        num_adjustments=report.adjustment.runs,
        last_adjustment=runs[-1] if runs else None,
        skipped=dict(report.skipped),
        time=perf_counter(),
    )
