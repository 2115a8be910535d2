# SPDX-License-Identifier: Apache-2.0
"""Returns that lie on walls of their own submaps: what passed by, and glass, is not among them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.quality.pairs import ON_WALL_M, WALL, cell_value
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid


def confirmed_returns(
    graph: PoseGraph, grids: Sequence[FinishedGrid], scans: ScanPoints, chosen: IntArray
) -> ScanPoints:
    """Return the scans of nodes with those returns only that a submap of their own confirms.

    People, thin legs and glass return some beams; most pass, so that no wall is left in the submap.
    Nodes that are in none of these submaps have no returns left.

    Parameters
    ----------
    graph : poses of the nodes in the submaps that they were inserted into.
    grids : of the first submaps.
    scans : the returns of all nodes.
    chosen : the submaps that count.
    """
    is_confirmed = np.zeros(len(scans.points), dtype=bool)
    own = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
    own = own[np.argsort(graph.index_a[own], kind="stable")]
    bounds = np.searchsorted(graph.index_a[own], np.arange(len(grids) + 1))
    for submap in chosen.tolist():
        rows = own[bounds[submap] : bounds[submap + 1]]
        if grids[submap].size and len(rows):
            _confirm(
                grids[submap],
                scans.take(graph.index_b[rows]),
                graph.relative_poses[rows],
                is_confirmed,
            )
    totals = np.concatenate(([0], np.cumsum(is_confirmed)))
    return ScanPoints(scans.points[is_confirmed], totals[scans.firsts], totals[scans.ends])


def _confirm(
    grid: FinishedGrid, scans: ScanPoints, tf_submap_node: FloatArray, out_confirmed: BoolArray
) -> None:
    """Note the returns of a submap's own nodes that lie on its walls."""
    from scipy import ndimage  # heavy, and rarely used

    walls = grid.cells >= cell_value(WALL)
    near = ndimage.distance_transform_edt(~walls) <= round(ON_WALL_M / grid.resolution)
    counts = scans.counts
    firsts = np.cumsum(counts) - counts
    numbers = np.arange(counts.sum()) + np.repeat(scans.firsts - firsts, counts)
    x, y, theta = np.repeat(tf_submap_node, counts, axis=0).T
    points = scans.points[numbers]
    cos, sin = np.cos(theta), np.sin(theta)
    cols = np.rint((x + cos * points[:, 0] - sin * points[:, 1] - grid.origin_x) / grid.resolution)
    rows = np.rint((y + sin * points[:, 0] + cos * points[:, 1] - grid.origin_y) / grid.resolution)
    inside = (cols >= 0) & (rows >= 0) & (cols < grid.shape[1]) & (rows < grid.shape[0])
    numbers = numbers[inside]
    on_wall = near[rows[inside].astype(np.int64), cols[inside].astype(np.int64)]
    out_confirmed[numbers[on_wall]] = True
