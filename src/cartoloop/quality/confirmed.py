# SPDX-License-Identifier: Apache-2.0
"""Returns that lie on walls of their own submaps: what passed by, and glass, is not among them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from cartoloop.arrays import BoolArray, ByteArray, FloatArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.quality.pairs import ON_WALL_M, WALL, cell_value
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid


class ConfirmedReturns:
    """Chooses those returns of scans that a submap of their own confirms.

    People, thin legs and glass return some beams; most pass, so that no wall is left in the submap.
    Submaps are finished: each is looked at once.
    """

    def __init__(self) -> None:
        # Of each submap, one bit for each return of its nodes, in the order of the graph.
        self._bits: dict[int, ByteArray] = {}
        # Two parts are compared in several shapes, one after the other.
        self._last: tuple[tuple[bytes, int, int], ScanPoints] | None = None

    def of(
        self, graph: PoseGraph, grids: Sequence[FinishedGrid], scans: ScanPoints, chosen: IntArray
    ) -> ScanPoints:
        """Return the scans of nodes with those returns only that are confirmed.

        Nodes that are in none of the chosen submaps have no returns left.

        Parameters
        ----------
        graph : poses of the nodes in the submaps that they were inserted into.
        grids : of the first submaps; the same ones in each call.
        scans : the returns of all nodes.
        chosen : the submaps that count.
        """
        num_own = int(np.count_nonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP))
        key = (chosen.tobytes(), num_own, len(scans.points))
        if self._last is not None and self._last[0] == key:
            return self._last[1]
        confirmed = self._confirmed(graph, grids, scans, chosen)
        self._last = key, confirmed
        return confirmed

    def _confirmed(
        self, graph: PoseGraph, grids: Sequence[FinishedGrid], scans: ScanPoints, chosen: IntArray
    ) -> ScanPoints:
        """Return what :meth:`of` does."""
        is_confirmed = np.zeros(len(scans.points), dtype=bool)
        rows_of = own_rows(graph, len(grids))
        for submap in chosen.tolist():
            rows = rows_of[submap]
            if not grids[submap].size or not len(rows):
                continue
            nodes = graph.index_b[rows]
            counts = scans.counts[nodes]
            ends = np.cumsum(counts)
            shifts = np.repeat(scans.firsts[nodes] - ends + counts, counts)
            numbers = np.arange(int(ends[-1])) + shifts
            if submap not in self._bits:
                poses = np.repeat(graph.relative_poses[rows], counts, axis=0)
                on_wall, _ = near_walls(grids[submap], scans.points[numbers], poses)
                self._bits[submap] = np.packbits(on_wall)
            bits = np.unpackbits(self._bits[submap], count=len(numbers))
            is_confirmed[numbers[bits.view(bool)]] = True
        totals = np.concatenate(([0], np.cumsum(is_confirmed)))
        return ScanPoints(scans.points[is_confirmed], totals[scans.firsts], totals[scans.ends])


def own_rows(graph: PoseGraph, num_submaps: int) -> list[IntArray]:
    """Return which constraints are of the nodes that were inserted into each of the submaps."""
    own = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
    own = own[np.argsort(graph.index_a[own], kind="stable")]
    bounds = np.searchsorted(graph.index_a[own], np.arange(num_submaps + 1))
    return [own[first:end] for first, end in pairwise(bounds.tolist())]


def near_walls(
    grid: FinishedGrid, points: FloatArray, tf_submap_node: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Return which points lie on walls of a submap, and which where it is known, shape (n,) each.

    Parameters
    ----------
    points : shape (n, 2), tracking frame [m].
    tf_submap_node : shape (n, 3), of the node of each.
    """
    from scipy import ndimage  # heavy, and rarely used

    walls = grid.cells >= cell_value(WALL)
    near = ndimage.distance_transform_edt(~walls) <= round(ON_WALL_M / grid.resolution)
    x, y, theta = tf_submap_node.T
    cos, sin = np.cos(theta), np.sin(theta)
    cols = np.rint((x + cos * points[:, 0] - sin * points[:, 1] - grid.origin_x) / grid.resolution)
    rows = np.rint((y + sin * points[:, 0] + cos * points[:, 1] - grid.origin_y) / grid.resolution)
    inside = (cols >= 0) & (rows >= 0) & (cols < grid.shape[1]) & (rows < grid.shape[0])
    places = rows[inside].astype(np.int64), cols[inside].astype(np.int64)
    on_wall: BoolArray = np.zeros(len(points), dtype=bool)
    is_known: BoolArray = np.zeros(len(points), dtype=bool)
    on_wall[inside] = near[places]
    is_known[inside] = (grid.cells[places] > 0) | near[places]
    return on_wall, is_known
