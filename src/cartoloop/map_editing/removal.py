# SPDX-License-Identifier: Apache-2.0
"""A map without some of its scans, and without some of the cells of its submaps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import NO_ROW, ConstraintKind, PoseGraph
from cartoloop.map_editing.rectangle import Rectangle
from cartoloop.submaps.finished_grid import FinishedGrid


class Kept(NamedTuple):
    """What is left of a map.

    Attributes
    ----------
    scans, nodes, submaps : increasing indices in the map as mapped.
    """

    scans: IntArray
    nodes: IntArray
    submaps: IntArray


def kept_of(graph: PoseGraph, node_scan_index: IntArray, is_forgotten: BoolArray) -> Kept:
    """Return what is left without some scans: without their nodes, and submaps of these alone."""
    node_is_kept = ~is_forgotten[node_scan_index]
    own = graph.kinds == ConstraintKind.INTRA_SUBMAP
    has_node, keeps_node = np.zeros((2, graph.num_submaps), dtype=bool)
    has_node[graph.index_a[own]] = True
    keeps_node[graph.index_a[own][node_is_kept[graph.index_b[own]]]] = True
    return Kept(
        np.flatnonzero(~is_forgotten),
        np.flatnonzero(node_is_kept),
        np.flatnonzero(keeps_node | ~has_node),
    )


def closures_left(closures: Closures, kept: Kept, graph: PoseGraph) -> tuple[Closures, IntArray]:
    """Return the record of the closures that are left, and the rows that they had."""
    submap, node = _places(kept.submaps, graph.num_submaps), _places(kept.nodes, graph.num_nodes)
    rows = np.flatnonzero((submap[closures.submap] >= 0) & (node[closures.node] >= 0))
    row = _places(rows, len(closures))
    requested = rows[rows < closures.num_requested]
    requests = closures.requests(requested.astype(np.int32))
    requests = requests._replace(
        submap=submap[requests.submap].astype(np.int32),
        node=node[requests.node].astype(np.int32),
        # A submap that holds a node that is left is left, too.
        node_submap=np.maximum(submap[requests.node_submap], 0).astype(np.int32),
    )
    table, num_found = closures.match_table, closures.num_found
    is_left = row[table.row] >= 0
    found = is_left[:num_found]
    left = table._replace(
        row=row[table.row][is_left],
        tf_submap_node=table.tf_submap_node[is_left],
        information=table.information[is_left],
        residual=table.residual[is_left],
        moved=table.moved[is_left],
        score=table.score[found],
        runner_up=table.runner_up[found],
        joined_at=table.joined_at[found],
    )
    restored = Closures.restored(
        (submap[closures.submap[rows]], node[closures.node[rows]]),
        (
            closures.status[rows].astype(np.int64),
            closures.reason[rows].astype(np.int64),
            closures.search_status[rows].astype(np.int64),
        ),
        requests,
        closures.min_score[requested],
        closures.requested_at[requested].astype(np.int64),
        left,
    )
    return restored, rows


def graph_left(graph: PoseGraph, kept: Kept, closure_rows: IntArray) -> PoseGraph:
    """Return the graph that is left; `closure_rows`: rows that the closures left had before."""
    submap, node = _places(kept.submaps, graph.num_submaps), _places(kept.nodes, graph.num_nodes)
    between_nodes = graph.kinds == ConstraintKind.NODE_TO_NODE
    index_a = np.where(
        between_nodes,
        node[np.where(between_nodes, graph.index_a, 0)] if graph.num_nodes else -1,
        submap[np.where(between_nodes, 0, graph.index_a)] if graph.num_submaps else -1,
    )
    index_b = node[graph.index_b]
    is_left = (index_a >= 0) & (index_b >= 0)
    left = PoseGraph()
    left.add_submaps(graph.submap_poses[kept.submaps])
    left.add_nodes(graph.node_poses[kept.nodes])
    row = np.append(_places(closure_rows, int(graph.closure_rows.max(initial=0)) + 1), NO_ROW)
    left.add_constraints(
        graph.kinds[is_left],
        index_a[is_left],
        index_b[is_left],
        graph.relative_poses[is_left],
        graph.informations[is_left],
        closure_rows=row[graph.closure_rows[is_left]],
        is_trusted=graph.is_trusted[is_left],
    )
    held = [submap[list(graph.fixed_submaps)], node[list(graph.fixed_nodes)]]
    submaps, nodes = (some[some >= 0].tolist() for some in held)
    if not submaps and not nodes and left.num_submaps:
        submaps = [0]
    left.hold_only(submaps, nodes)
    return left


def without_areas(grid: FinishedGrid, areas: Sequence[Rectangle]) -> FinishedGrid:
    """Return a grid whose cells in rectangles, in its frame, were never observed."""
    rows, cols = grid.shape
    corners = np.array([(0, 0), (0, cols), (rows, 0), (rows, cols)])
    centre, radius = _positions(grid, corners.mean(axis=0)[np.newaxis])[0], _radius(grid)
    near = [area for area in areas if _distance(area, centre) <= radius]
    if not near or grid.size == 0:
        return grid
    cells = grid.cells.copy()
    seen = np.argwhere(cells)
    positions = _positions(grid, seen)
    inside = np.zeros(len(seen), dtype=bool)
    for area in near:
        inside |= area.contains(positions)
    return _cleared(grid, cells, seen[inside])


def without_nodes(grid: FinishedGrid, kept: FloatArray, forgotten: FloatArray) -> FinishedGrid:
    """Return a grid without the cells that lie nearer to a forgotten node than to one kept.

    What single scans have added to a cell is not known any more.

    Parameters
    ----------
    grid : of a submap.
    kept, forgotten : positions of the nodes that were inserted into it, shapes (n, 2), (m, 2)
        [m, submap frame]; neither is empty.
    """
    cells = grid.cells.copy()
    seen = np.argwhere(cells)
    if len(seen) == 0:
        return grid
    positions = _positions(grid, seen)
    to_kept, to_forgotten = (KDTree(nodes).query(positions)[0] for nodes in (kept, forgotten))
    return _cleared(grid, cells, seen[to_forgotten < to_kept])


def own_positions(graph: PoseGraph, submap: int) -> tuple[IntArray, FloatArray]:
    """Return the nodes inserted into a submap, and where they are in it, shape (n, 2) [m]."""
    own = (graph.kinds == ConstraintKind.INTRA_SUBMAP) & (graph.index_a == submap)
    return graph.index_b[own], graph.relative_poses[own, :2]


def _cleared(grid: FinishedGrid, cells: NDArray[np.uint8], which: IntArray) -> FinishedGrid:
    if len(which) == 0:
        return grid
    cells[which[:, 0], which[:, 1]] = 0
    return FinishedGrid(cells, grid.origin_x, grid.origin_y, grid.resolution)


def _positions(grid: FinishedGrid, cells: NDArray[np.integer | np.floating]) -> FloatArray:
    """Return the centres of cells (row, column), shape (n, 2) [m, submap frame]."""
    offset = np.array((grid.origin_x, grid.origin_y))
    positions: FloatArray = cells[:, ::-1] * grid.resolution + offset
    return positions


def _radius(grid: FinishedGrid) -> float:
    return 0.5 * grid.resolution * float(np.hypot(*grid.shape)) + grid.resolution


def _distance(area: Rectangle, point: FloatArray) -> float:
    """Return the distance of a point from a rectangle [m]."""
    dx, dy = point[0] - area.corner.x, point[1] - area.corner.y
    cos, sin = np.cos(area.corner.theta), np.sin(area.corner.theta)
    along, across = cos * dx + sin * dy, cos * dy - sin * dx
    outside = max(-along, along - area.width, 0.0), max(-across, across - area.height, 0.0)
    return float(np.hypot(*outside))


def _places(kept: IntArray, size: int) -> IntArray:
    """Return the place of each of `size` indices among those kept, -1 where it is not."""
    places = np.full(size, -1, dtype=np.int64)
    places[kept] = np.arange(len(kept))
    return places
