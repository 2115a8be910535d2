# SPDX-License-Identifier: Apache-2.0
"""What mapping yields, as data: poses, pose graph, submaps, and how they came about.

All that is written, drawn, explained or evaluated is made of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartoloop.config import Config
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.trajectory import path_length
from cartoloop.quality.verdict import Quality
from cartoloop.report import InputSummary, Report
from cartoloop.session import Session, parts_of, ranges
from cartoloop.submaps.finished_grid import FinishedGrid


@dataclass(frozen=True, slots=True)
class Edit:
    """One edit of a finished map. Its number is its place among the edits of the map.

    Attributes
    ----------
    kind : word of `map_editing.arguments.KINDS`.
    arguments : values of JSON; submaps, nodes and poses are those of the map as mapped.
    is_undone : whether it is only remembered.
    """

    kind: str
    arguments: Mapping[str, Any]
    is_undone: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class MapData:
    """A finished map, or a snapshot of a growing one.

    Attributes
    ----------
    stamps : float64 (n,), as recorded, in file order, one for each scan that got a pose [s].
    trajectory : float64 (n, 3), ``tf_map_tracking`` of each scan, optimised [m, m, rad].
    local_trajectory : float64 (n, 3), ``tf_local_tracking``, before loop closure.
    graph : poses of nodes and submaps, and the constraints between them.
    node_scan_index : int64 (k,), which of the n scans each node is.
    submap_grids : one for each submap of the graph, in its order.
    config : the parameters used.
    report : what happened.
    closures : the record of all pairs of submap and node that were searched or matched.
    node_points : of each node the returns that searches match [m], tracking frame.
    sessions : the drives that it is made of, in order, at least one.
    edits : all edits of the map, in order, those undone among them.
    original : the map as mapped, where edits have changed this one; it has the same `edits`.
    edited_quality : of a map as mapped that has edits, the verdict on it with them; None where that
        was not examined.
    """

    stamps: NDArray[np.float64]
    trajectory: NDArray[np.float64]
    local_trajectory: NDArray[np.float64]
    graph: PoseGraph
    node_scan_index: NDArray[np.int64]
    submap_grids: list[FinishedGrid]
    config: Config
    report: Report
    closures: Closures = field(default_factory=Closures)
    node_points: Sequence[NDArray[np.float64]] = ()
    sessions: tuple[Session, ...] = (Session(),)
    edits: tuple[Edit, ...] = ()
    original: MapData | None = None
    edited_quality: Quality | None = None

    @property
    def submap_parts(self) -> NDArray[np.int64]:
        """Number of the connected part that each submap belongs to, int64 (m,)."""
        firsts = [session.first_submap for session in self.sessions]
        return parts_of(self.sessions, firsts, self.graph.num_submaps)

    @property
    def node_parts(self) -> NDArray[np.int64]:
        """Number of the connected part that each node belongs to, int64 (k,)."""
        firsts = [session.first_node for session in self.sessions]
        return parts_of(self.sessions, firsts, self.graph.num_nodes)

    @property
    def scan_parts(self) -> NDArray[np.int64]:
        """Number of the connected part that each scan belongs to, int64 (n,)."""
        firsts = [session.first_scan for session in self.sessions]
        return parts_of(self.sessions, firsts, len(self.stamps))


def input_left(before: MapData, after: MapData) -> InputSummary:
    """Return the summary of the scans that a map still has.

    Parameters
    ----------
    before, after : the map and its report, and what is left of its scans and sessions.
    """
    firsts = [session.first_scan for session in after.sessions]
    scans = [part for part in ranges(firsts, len(after.stamps)) if part.stop > part.start]
    removed, known = len(before.stamps) - len(after.stamps), before.report.input
    durations = [float(np.ptp(after.stamps[part])) for part in scans]
    return replace(
        known,
        scans=known.scans - removed,
        duration_s=sum(durations) if removed else known.duration_s,
        path_length_m=sum(path_length(after.trajectory[part]) for part in scans),
    )
