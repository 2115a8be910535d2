# SPDX-License-Identifier: Apache-2.0
"""Which scans show what which submaps show, if all are placed where they truly were taken.

A scan that was not inserted into a submap, but shows it, could have closed a loop.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import CellArray, FloatArray, IntArray
from cartoloop.config import Config
from cartoloop.errors import InputError
from cartoloop.kernels.voxel_filter import voxel_filter
from cartoloop.sensor.events import LaserScan, PointCloud, SensorEvent
from cartoloop.sensor.pose import Pose, transform_points
from cartoloop.sensor.range_filter import RangeFilter, thin

CELL_M = 0.1
"""Edge of the cells [m]; a point agrees with a submap in whose cell, or the next, it lies."""

MIN_SHARE = 0.6
"""Share of a scan's points that must agree with a submap for the scan to show it, by default."""

MAX_SAMPLE = 100
"""Number of points of a scan that are compared."""

MAX_EXTENT_M = 2000.0
"""No submap reaches so far."""


@dataclass(frozen=True)
class PlacedScans:
    """Scans at their true poses, as cells of one lattice of edge `CELL_M`.

    Attributes
    ----------
    hits : int32 (h, 2), the cells that a scan's returns lie in, scan after scan.
    hits_start : int64 (n + 1,), where those of each scan begin.
    sample : int32 (m, 2), the cells of some of each scan's points, spread out evenly.
    sample_start : int64 (n + 1,).
    """

    hits: CellArray
    hits_start: IntArray
    sample: CellArray
    sample_start: IntArray

    def __len__(self) -> int:
        return len(self.hits_start) - 1


def place_scans(
    events: Iterable[SensorEvent],
    stamps: FloatArray,
    true_poses: FloatArray,
    config: Config,
    name: str,
) -> PlacedScans:
    """Return the scans that became nodes, at their true poses.

    Parameters
    ----------
    events : of the recording that was mapped.
    stamps : names of the nodes' scans, shape (n,) [s], in the order of the recording.
    true_poses : of the nodes, shape (n, 3) [m, m, rad].
    config : with which it was mapped; the points are filtered as for loop closures.
    name : of the recording, for messages.

    Raises
    ------
    InputError
        The recording lacks a scan of `stamps`.
    """
    range_filter = RangeFilter(config.sensor)
    hits: list[CellArray] = []
    sample: list[CellArray] = []
    # near the origin, cells of faraway places (UTM) fit into 32 bits
    poses = true_poses - np.append(true_poses[0, :2], 0.0)
    for event in events:
        # in the order of the recording: stamps may run backwards and repeat
        if len(hits) == len(stamps):
            break
        if not isinstance(event, LaserScan | PointCloud) or event.stamp != stamps[len(hits)]:
            continue
        pose = Pose(*poses[len(hits)].tolist())
        returns = range_filter.apply(event).returns
        points = thin(returns, config.global_slam.constraint_search.adaptive_voxel_filter)
        kept = min(len(points), MAX_SAMPLE)
        points = points[np.arange(kept) * len(points) // max(kept, 1)]
        placed = transform_points(pose, returns)
        num_cells = voxel_filter(placed, len(placed), CELL_M, placed)
        hits.append(_cells(placed[:num_cells]))
        sample.append(_cells(transform_points(pose, points)))
    if len(hits) < len(stamps):
        raise InputError(
            f"{name}: has no scan of stamp {stamps[len(hits)]:.6f} in its place, which node "
            f"{len(hits)} has: give the recording that was mapped"
        )
    return PlacedScans(*_joined(hits), *_joined(sample))


def closable_pairs(
    scans: PlacedScans,
    own_submap: IntArray,
    own_node: IntArray,
    num_submaps: int,
    min_num_points: int,
    min_share: float = MIN_SHARE,
) -> IntArray:
    """Return the pairs (submap, node) that a loop could have been closed with, int64 (k, 2).

    Those where the node was not inserted into the submap, has enough points, and `min_share` of
    these lie in a cell that a scan of the submap hit, or next to one. In ascending order.

    Parameters
    ----------
    scans : of all nodes.
    own_submap, own_node : which nodes were inserted into which submaps, shape (m,).
    num_submaps : how many submaps there are.
    min_num_points : scans with fewer show too little.
    min_share : in (0, 1].

    Raises
    ------
    InputError
        The true poses scatter the scans of a submap so far that they cannot be true.

    Notes
    -----
    A bitmap of one submap at a time; linear in the points of the scans whose extent meets its own.
    """
    counts = np.diff(scans.sample_start)
    low, high = _extents(scans)
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for submap in range(num_submaps):
        own = own_node[own_submap == submap]
        cells = scans.hits[_rows(scans.hits_start, own)]
        if len(cells) == 0:
            continue
        origin, near = _bitmap(cells, submap)
        meets = np.all((low < origin + near.shape) & (high >= origin), axis=1)
        meets &= counts >= max(min_num_points, 1)
        meets[own] = False
        nodes = np.flatnonzero(meets)
        if len(nodes) == 0:
            continue
        agrees = _lookup(near, scans.sample[_rows(scans.sample_start, nodes)] - origin)
        first = np.concatenate(([0], np.cumsum(counts[nodes])[:-1]))
        share = np.add.reduceat(agrees.astype(np.int64), first) / counts[nodes]
        shown = nodes[share >= min_share]
        pairs.append(np.column_stack((np.full(len(shown), submap), shown)))
    return np.concatenate(pairs)


def _bitmap(cells: CellArray, submap: int) -> tuple[CellArray, NDArray[np.bool_]]:
    """Return where a bitmap begins, and it: which cells are among these, or next to one."""
    origin = cells.min(axis=0) - 1
    shape = cells.max(axis=0) - origin + 2
    if np.any(shape * CELL_M > MAX_EXTENT_M):
        raise InputError(
            f"the truth scatters the scans of submap {submap} over {shape.max() * CELL_M:.0f} m: "
            "is it of this recording, and in metres?"
        )
    hit = np.zeros(shape, dtype=np.bool_)
    hit[cells[:, 0] - origin[0], cells[:, 1] - origin[1]] = True
    rows = hit.copy()
    rows[1:] |= hit[:-1]
    rows[:-1] |= hit[1:]
    near = rows.copy()
    near[:, 1:] |= rows[:, :-1]
    near[:, :-1] |= rows[:, 1:]
    return origin, near


def _lookup(bitmap: NDArray[np.bool_], cells: CellArray) -> NDArray[np.bool_]:
    """Return what the bitmap holds at cells (k, 2), False outside it."""
    inside = np.all((cells >= 0) & (cells < bitmap.shape), axis=1)
    found: NDArray[np.bool_] = np.zeros(len(cells), dtype=np.bool_)
    found[inside] = bitmap[cells[inside, 0], cells[inside, 1]]
    return found


def _extents(scans: PlacedScans) -> tuple[IntArray, IntArray]:
    """Return the least and the greatest cell of each scan's sample, (n, 2) each."""
    low = np.zeros((len(scans), 2), dtype=np.int64)
    high = np.full((len(scans), 2), -1, dtype=np.int64)
    filled = np.flatnonzero(np.diff(scans.sample_start))
    if len(filled):
        first = scans.sample_start[filled]
        low[filled] = np.minimum.reduceat(scans.sample, first, axis=0)
        high[filled] = np.maximum.reduceat(scans.sample, first, axis=0)
    return low, high


def _rows(start: IntArray, chosen: IntArray) -> IntArray:
    """Return the rows of the chosen scans, one scan after the other."""
    counts = start[chosen + 1] - start[chosen]
    skipped = np.repeat(start[chosen] - (np.cumsum(counts) - counts), counts)
    rows: IntArray = np.arange(len(skipped)) + skipped
    return rows


def _cells(points: FloatArray) -> CellArray:
    return np.floor(points / CELL_M).astype(np.int32)


def _joined(parts: list[CellArray]) -> tuple[CellArray, IntArray]:
    counts = [len(part) for part in parts]
    return np.concatenate(parts), np.concatenate(([0], np.cumsum(counts, dtype=np.int64)))
