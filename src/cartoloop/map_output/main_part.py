# SPDX-License-Identifier: Apache-2.0
"""What of a map is drawn and exported: its main part, whose sessions are joined."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.map_data import MapData
from cartoloop.session import MAIN_PART, ranges
from cartoloop.submaps.finished_grid import FinishedGrid


class MainSubmaps(NamedTuple):
    """The submaps of the main part.

    Attributes
    ----------
    grids : of each.
    poses : float64, shape (m, 3), tf_map_submap.
    """

    grids: list[FinishedGrid]
    poses: FloatArray


def main_submaps(result: MapData) -> MainSubmaps:
    """Return the submaps of the main part of a map."""
    chosen = np.flatnonzero(result.submap_parts == MAIN_PART)
    if len(chosen) == result.graph.num_submaps:
        return MainSubmaps(result.submap_grids, result.graph.submap_poses)
    grids = [result.submap_grids[submap] for submap in chosen.tolist()]
    return MainSubmaps(grids, result.graph.submap_poses[chosen])


def main_nodes(result: MapData) -> NDArray[np.int64]:
    """Return the nodes of the main part of a map."""
    return np.flatnonzero(result.node_parts == MAIN_PART)


def main_scans(result: MapData) -> NDArray[np.int64]:
    """Return the scans of the main part, by their stamps; those of one session in file order.

    Stamps of a recording may run backwards: a scan counts as no earlier than those before it.
    """
    if len(result.sessions) == 1:
        return np.arange(len(result.stamps))
    times = np.empty(len(result.stamps))
    for scans in ranges([session.first_scan for session in result.sessions], len(times)):
        times[scans] = np.maximum.accumulate(result.stamps[scans])
    chosen = np.flatnonzero(result.scan_parts == MAIN_PART)
    in_order: NDArray[np.int64] = chosen[np.argsort(times[chosen], kind="stable")]
    return in_order


def main_path(result: MapData) -> FloatArray:
    """Return the path of the main part to be drawn: NaN between sessions, float64, shape (n, 3)."""
    if len(result.sessions) == 1:
        return result.trajectory
    end = np.full((1, 3), np.nan)
    paths: list[FloatArray] = []
    firsts = [session.first_scan for session in result.sessions]
    for session, scans in zip(result.sessions, ranges(firsts, len(result.stamps)), strict=True):
        if session.part == MAIN_PART:
            paths += [result.trajectory[scans], end]
    return np.concatenate(paths[:-1]) if paths else np.zeros((0, 3))
