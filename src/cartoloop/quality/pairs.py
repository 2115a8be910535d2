# SPDX-License-Identifier: Apache-2.0
"""Which scans are compared with which submaps, and how well they agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import QualityConfig
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.kernels.map_agreement import AgreementLimits, CellGrid
from cartoloop.quality.agreement import agreement, farthest_return, sure_floor
from cartoloop.sensor.pose import compose_all, relative_all
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.session import Session
from cartoloop.submaps.finished_grid import MIN_PROBABILITY, PROBABILITY_STEP, FinishedGrid

WALL = 0.57
"""Least probability of a cell that counts as a wall: hit more often than missed."""

FLOOR = 0.35
"""Largest probability of a cell that counts as floor: missed by some four beams and never hit."""

ON_WALL_M, OFF_WALL_M = 0.1, 0.2
"""A return with a wall within the first distance agrees; on floor with none within the second it
contradicts [m]. Walls have the thickness of noise and pixels, two to three cells."""

OWN_STRIDE = 3
"""One in three of a submap's own nodes is a reference for others: nodes are 0.2 m apart."""

MIN_DETOUR = 3.0
"""Nodes from which a place is only seen are of another visit if the path there is this many times
the distance: who drives towards a place or leaves it sees it, too."""

MIN_COUNTED = 20
"""Pairs with fewer returns on walls or floor say nothing."""


class MapContent(Protocol):
    """What is examined; the attributes are those of `map_data.MapData`."""

    @property
    def stamps(self) -> NDArray[np.float64]: ...  # noqa: D102
    @property
    def trajectory(self) -> NDArray[np.float64]: ...  # noqa: D102
    @property
    def local_trajectory(self) -> NDArray[np.float64]: ...  # noqa: D102
    @property
    def graph(self) -> PoseGraph: ...  # noqa: D102
    @property
    def node_scan_index(self) -> NDArray[np.int64]: ...  # noqa: D102
    @property
    def submap_grids(self) -> list[FinishedGrid]: ...  # noqa: D102
    @property
    def node_points(self) -> Sequence[NDArray[np.float64]]: ...  # noqa: D102
    @property
    def sessions(self) -> tuple[Session, ...]: ...  # noqa: D102
    @property
    def node_parts(self) -> NDArray[np.int64]: ...  # noqa: D102
    @property
    def submap_parts(self) -> NDArray[np.int64]: ...  # noqa: D102


class MapEdit(Protocol):
    """An edit of a map; the attributes are those of `map_data.Edit`."""

    @property
    def kind(self) -> str: ...  # noqa: D102
    @property
    def is_undone(self) -> bool: ...  # noqa: D102


class MappedContent(MapContent, Protocol):
    """A whole map, with the record of its loop closures, and its edits."""

    @property
    def closures(self) -> Closures: ...  # noqa: D102
    @property
    def edits(self) -> Sequence[MapEdit]: ...  # noqa: D102


@dataclass(frozen=True)
class Pairs:
    """Nodes compared with submaps that they were not inserted into, n pairs.

    Attributes
    ----------
    submap, node : int64 (n,).
    own_node : int64 (n,), the node of the submap that is nearest to the other on the map.
    tf_submap_node : float64 (n, 3), by the map's poses of both nodes [m, m, rad].
    path : float64 (n,), path length from the node to the nearest end of the submap [m].
    distance : float64 (n,), from the node to the path of the submap [m].
    on_wall, on_floor : int64 (n,), the returns that agree with the submap, and that do not.
    """

    submap: IntArray
    node: IntArray
    own_node: IntArray
    tf_submap_node: FloatArray
    path: FloatArray
    distance: FloatArray
    on_wall: IntArray
    on_floor: IntArray

    def __len__(self) -> int:
        return len(self.submap)

    @property
    def contradiction(self) -> FloatArray:
        """Share of the counted returns that lie on floor."""
        share: FloatArray = self.on_floor / np.maximum(self.on_wall + self.on_floor, 1)
        return share

    def take(self, rows: NDArray[np.bool_] | IntArray) -> Pairs:
        """Return some of the pairs."""
        return Pairs(*(column[rows] for column in vars(self).values()))


class Reach(NamedTuple):
    """How far from the path of a submap nodes are compared with it, and how far they see.

    Attributes
    ----------
    nearby : distance of all nodes [m].
    visit : distance of nodes that come back to where they see the submap, not smaller [m].
    scanner : distance of the farthest return of all nodes [m].
    """

    nearby: float
    visit: float
    scanner: float

    def of(self, path: FloatArray) -> FloatArray:
        """Return the distance for the path lengths from nodes to a submap [m]."""
        return np.where(path >= MIN_DETOUR * self.visit, self.visit, self.nearby)


def scans_of(content: MapContent) -> ScanPoints:
    """Return the returns of a map's nodes."""
    points = content.node_points
    return points if isinstance(points, ScanPoints) else ScanPoints.of(points)


def path_lengths(node_poses: FloatArray) -> FloatArray:
    """Return the length of the path from the first node to each, shape (n,) [m]."""
    steps = np.linalg.norm(np.diff(node_poses[:, :2], axis=0), axis=1)
    lengths: FloatArray = np.concatenate(([0.0], np.cumsum(steps)))[: len(node_poses)]
    return lengths


def compared_pairs(
    content: MapContent,
    scans: ScanPoints,
    config: QualityConfig,
    paths: FloatArray,
    comparable: Callable[[int], BoolArray] | None = None,
    visit_distance: float | None = None,
) -> Pairs:
    """Return the pairs of a map that overlap, with their agreement.

    Parameters
    ----------
    content : the map.
    scans : the returns of its nodes.
    config : limits.
    paths : path length of each node [m].
    comparable : returns which nodes may be compared with a submap, shape (n,); None: all.
    visit_distance : nodes that come back are compared up to this distance from the path of a
        submap [m]; None: up to `config.nearby`, as others are.

    Poses within a submap are those at which its scans were inserted: the node is placed by the
    nearest of them, so that a submap that is bent far away does not matter here.
    """
    graph = content.graph
    own = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
    own = own[np.argsort(graph.index_a[own], kind="stable")]
    bounds = np.searchsorted(graph.index_a[own], np.arange(graph.num_submaps + 1))
    visit = max(config.nearby, visit_distance or 0.0)
    reach = Reach(config.nearby, visit, farthest_return(scans))
    parts = []
    for submap, grid in enumerate(content.submap_grids):
        rows = own[bounds[submap] : bounds[submap + 1]]
        if grid.size and len(rows):
            chosen = None if comparable is None else comparable(submap)
            parts.append(_pairs_of(submap, grid, graph, rows, paths, scans, config, reach, chosen))
    if not parts:
        none, no_lengths = np.zeros(0, np.int64), np.zeros(0)
        return Pairs(none, none, none, np.zeros((0, 3)), no_lengths, no_lengths, none, none)
    columns = zip(*(vars(part).values() for part in parts), strict=True)
    pairs = Pairs(*(np.concatenate(column) for column in columns))
    return pairs.take(pairs.on_wall + pairs.on_floor >= MIN_COUNTED)


def _pairs_of(
    submap: int,
    grid: FinishedGrid,
    graph: PoseGraph,
    own: IntArray,
    paths: FloatArray,
    scans: ScanPoints,
    config: QualityConfig,
    reach: Reach,
    comparable: BoolArray | None,
) -> Pairs:
    """Return the pairs of one submap; `own` are the constraints of its nodes, in order."""
    poses = graph.node_poses
    first, last = int(graph.index_b[own].min()), int(graph.index_b[own].max())
    of_submap, own = own, own[::OWN_STRIDE]
    references = graph.index_b[own]
    places = poses[references, :2]
    numbers = np.arange(len(poses))
    is_candidate = np.all(
        (poses[:, :2] > places.min(axis=0) - reach.visit)
        & (poses[:, :2] < places.max(axis=0) + reach.visit),
        axis=1,
    )
    is_candidate &= (numbers + submap) % config.every_nth_node == 0
    is_candidate &= (numbers < first) | (numbers > last)
    if comparable is not None:
        is_candidate &= comparable
    nodes = np.flatnonzero(is_candidate)
    squared = (poses[nodes, 0, np.newaxis] - places[:, 0]) ** 2
    squared += (poses[nodes, 1, np.newaxis] - places[:, 1]) ** 2
    nearest = squared.argmin(axis=1) if len(nodes) else np.zeros(0, np.int64)
    path = np.where(nodes < first, paths[first] - paths[nodes], paths[nodes] - paths[last])
    distance = np.hypot(*(poses[nodes, :2] - places[nearest]).T)
    rows = distance < reach.of(path)
    nodes, nearest, path, distance = nodes[rows], nearest[rows], path[rows], distance[rows]
    tf_submap_node = compose_all(
        graph.relative_poses[own[nearest]], relative_all(poses[references[nearest]], poses[nodes])
    )
    limits = agreement_limits(grid.resolution, config.max_range)
    floor = sure_floor(
        cell_grid(grid),
        limits,
        scans.take(graph.index_b[of_submap]),
        graph.relative_poses[of_submap],
        reach.scanner,
    )
    counts = np.zeros((len(nodes), 2), dtype=np.int64)
    is_visit = path >= config.min_visit_path
    for cells, chosen in ((floor.of_visits, is_visit), (floor.consecutive, ~is_visit)):
        compared = scans.take(nodes[chosen])
        counts[chosen] = agreement(cells, limits, compared, tf_submap_node[chosen])
    return Pairs(
        np.full(len(nodes), submap),
        nodes,
        references[nearest],
        tf_submap_node,
        path,
        distance,
        counts[:, 0],
        counts[:, 1],
    )


def agreement_limits(resolution: float, max_range: float) -> AgreementLimits:
    """Return what counts as a wall and as floor in a submap of a resolution [m].

    Parameters
    ----------
    max_range : returns farther from the robot are not counted [m].
    """
    return AgreementLimits(
        cell_value(WALL),
        cell_value(FLOOR),
        round(ON_WALL_M / resolution),
        round(OFF_WALL_M / resolution),
        max_range,
    )


def cell_grid(grid: FinishedGrid) -> CellGrid:
    """Return a grid as kernels take it."""
    return CellGrid(grid.cells, grid.origin_x, grid.origin_y, grid.resolution)


def cell_value(probability: float) -> int:
    """Return the value of cells with a probability."""
    return round((probability - MIN_PROBABILITY) / PROBABILITY_STEP) + 1
