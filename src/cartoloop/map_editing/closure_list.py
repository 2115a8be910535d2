# SPDX-License-Identifier: Apache-2.0
"""The loop closures of a map as a list: each with its fate and reason."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from cartoloop.errors import UsageError
from cartoloop.global_slam.closure_residuals import residuals, weights
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.map_data import MapData


@dataclass(frozen=True, slots=True)
class ClosureRow:
    """A pair of submap and node that was requested or matched.

    Attributes
    ----------
    number : its row in ``closures.csv``.
    submap, node : the pair.
    status, reason : words of `Status` and `Reason`: its fate.
    is_in_graph : whether it is a constraint of the map.
    score : of the search; None where it found nothing.
    residual_m, residual_deg : by how much the map disagrees with it; None where it has no match.
    weight : factor of its information under the robust loss, in [0, 1]; likewise.
    """

    number: int
    submap: int
    node: int
    status: str
    reason: str
    is_in_graph: bool
    score: float | None
    residual_m: float | None
    residual_deg: float | None
    weight: float | None


def closure_rows(
    content: MapData,
    *,
    statuses: Iterable[str] = (),
    submap: int | None = None,
    node: int | None = None,
    worst: int | None = None,
) -> list[ClosureRow]:
    """Return the closures of a map, in the order of the record.

    Parameters
    ----------
    content : the map.
    statuses : only those with one of these; none for all.
    submap, node : only those of these.
    worst : only this number of those in the graph that the map disagrees with most, the worst
        first.

    Raises
    ------
    UsageError
        There is no such status.
    """
    closures, graph = content.closures, content.graph
    codes = [_status(word) for word in statuses]
    chosen = np.isin(closures.status, codes) if codes else np.ones(len(closures), dtype=bool)
    if submap is not None:
        chosen &= closures.submap == submap
    if node is not None:
        chosen &= closures.node == node
    in_graph = np.zeros(len(closures), dtype=bool)
    in_graph[graph.closure_rows[graph.closure_rows >= 0]] = True
    measured = closures.measured
    metres, radians, weight = np.full((3, len(closures)), math.nan)
    poses = graph.submap_poses, graph.node_poses
    metres[measured.row], radians[measured.row] = residuals(measured, *poses)
    config = content.config.global_slam.pose_adjustment
    weight[measured.row] = weights(measured, *poses, config)
    rows = np.flatnonzero(chosen)
    if worst is not None:
        rows = rows[in_graph[rows]]
        rows = rows[np.argsort(-metres[rows], kind="stable")][:worst]
    score = closures.score
    return [
        ClosureRow(
            number=row,
            submap=int(closures.submap[row]),
            node=int(closures.node[row]),
            status=Status(int(closures.status[row])).text,
            reason=Reason(int(closures.reason[row])).text,
            is_in_graph=bool(in_graph[row]),
            score=_known(score[row]),
            residual_m=_known(metres[row]),
            residual_deg=_known(math.degrees(radians[row])),
            weight=_known(weight[row]),
        )
        for row in rows.tolist()
    ]


def _status(word: str) -> Status:
    names = {status.text: status for status in Status}
    if word not in names:
        raise UsageError(f"no status {word!r}: choose from {', '.join(names)}")
    return names[word]


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
