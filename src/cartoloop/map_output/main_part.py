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
