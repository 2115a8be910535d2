# SPDX-License-Identifier: Apache-2.0
"""A map without some of its scans, and without some of the cells of its submaps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import NO_ROW, ConstraintKind, PoseGraph
from cartoloop.map_editing.rectangle import Rectangle
from cartoloop.sensor.pose import transform_points
from cartoloop.submaps.finished_grid import FinishedGrid

_BLOCK = 4
"""Edge of a block of cells that is forgotten or kept as a whole."""


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
    num_rows = max(int(graph.closure_rows.max(initial=0)), int(closure_rows.max(initial=0))) + 1
    row = np.append(_places(closure_rows, num_rows), NO_ROW)  # the last is found by NO_ROW
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
    boxes = [(area, box) for area in areas if (box := _box(grid, area)) is not None]
    if not boxes:
        return grid
    cells, is_changed = grid.cells.copy(), False
    for area, (rows, cols) in boxes:
        part, inside = cells[rows, cols], _inside(grid, area, rows, cols)
        is_changed |= bool(part[inside].any())
        part[inside] = 0
    if not is_changed:
        return grid
    return FinishedGrid(cells, grid.origin_x, grid.origin_y, grid.resolution)


def is_known_in(grid: FinishedGrid, area: Rectangle) -> bool:
    """Return whether a cell of a grid in a rectangle, in its frame, was observed."""
    if (box := _box(grid, area)) is None:
        return False
    return bool(grid.cells[box][_inside(grid, area, *box)].any())


def without_nodes(grid: FinishedGrid, kept: FloatArray, forgotten: FloatArray) -> FinishedGrid:
    """Return a grid without the cells that lie nearer to a forgotten node than to one kept.

    What single scans have added to a cell is not known any more. It is decided for blocks of cells.

    Parameters
    ----------
    grid : of a submap.
    kept, forgotten : positions of the nodes that were inserted into it, shapes (n, 2), (m, 2)
        [m, submap frame]; neither is empty.
    """
    from scipy.spatial import KDTree  # slow to import, and few edits need it

    num_rows, num_cols = grid.shape
    if grid.size == 0:
        return grid
    offset = 0.5 * (_BLOCK - 1) * grid.resolution
    x = grid.origin_x + offset + np.arange(0, num_cols, _BLOCK) * grid.resolution
    y = grid.origin_y + offset + np.arange(0, num_rows, _BLOCK) * grid.resolution
    blocks = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    to_kept, to_forgotten = (KDTree(nodes).query(blocks)[0] for nodes in (kept, forgotten))
    is_lost = (to_forgotten < to_kept).reshape(len(y), len(x))
    is_lost = np.repeat(np.repeat(is_lost, _BLOCK, axis=0), _BLOCK, axis=1)
    cells = np.where(is_lost[:num_rows, :num_cols], np.uint8(0), grid.cells)
    return FinishedGrid(cells, grid.origin_x, grid.origin_y, grid.resolution)


def own_positions(graph: PoseGraph, submap: int) -> tuple[IntArray, FloatArray]:
    """Return the nodes inserted into a submap, and where they are in it, shape (n, 2) [m]."""
    own = (graph.kinds == ConstraintKind.INTRA_SUBMAP) & (graph.index_a == submap)
    return graph.index_b[own], graph.relative_poses[own, :2]


def _box(grid: FinishedGrid, area: Rectangle) -> tuple[slice, slice] | None:
    """Return the rows and columns of a grid around a rectangle; None where it is outside."""
    corners = np.array([(0.0, 0.0), (area.width, 0.0), (0.0, area.height), area[1:]])
    corners = transform_points(area.corner, corners)
    origin, shape = np.array((grid.origin_x, grid.origin_y)), np.array(grid.shape[::-1])
    first = np.floor((corners.min(axis=0) - origin) / grid.resolution)
    last = np.ceil((corners.max(axis=0) - origin) / grid.resolution)
    first = np.clip(first, 0, shape).astype(np.int64)
    end = np.clip(last + 1, 0, shape).astype(np.int64)
    if np.any(first >= end):
        return None
    return slice(int(first[1]), int(end[1])), slice(int(first[0]), int(end[0]))


def _inside(grid: FinishedGrid, area: Rectangle, rows: slice, cols: slice) -> BoolArray:
    """Return which of some cells of a grid are in a rectangle, by rows and columns."""
    x = grid.origin_x + np.arange(cols.start, cols.stop) * grid.resolution
    y = grid.origin_y + np.arange(rows.start, rows.stop) * grid.resolution
    positions = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return area.contains(positions).reshape(len(y), len(x))


def _places(kept: IntArray, size: int) -> IntArray:
    """Return the place of each of `size` indices among those kept, -1 where it is not."""
    places = np.full(size, -1, dtype=np.int64)
    places[kept] = np.arange(len(kept))
    return places
