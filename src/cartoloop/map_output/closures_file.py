# SPDX-License-Identifier: Apache-2.0
"""Nodes and loop closures as CSV files: what is needed to explain each closure of a finished run.

``nodes.csv`` has one row a node, ``closures.csv`` one row a loop closure and stage; empty fields
are values that do not exist.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cartoloop.global_slam.loop_closure import Closures, closures_in
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.map_output.text_files import format_stamp
from cartoloop.pose_adjustment import loss_weights
from cartoloop.sensor.pose import relative_all, wrap_angles

if TYPE_CHECKING:
    from cartoloop.config import PoseAdjustmentConfig
    from cartoloop.map_output.result import Result

FloatArray = NDArray[np.float64]

NODE_COLUMNS = ("node", "stamp", "submaps")
"""Index of the node, stamp of its scan [s], indices of its submaps separated by blanks."""

CLOSURE_COLUMNS = (
    "stage",
    "submap",
    "node",
    "x",
    "y",
    "theta",
    "score",
    "runner_up",
    "residual_m",
    "residual_deg",
    "weight",
)
"""The measured pose is tf_submap_node [m, m, rad]; residual and weight are at the final poses.

The weight is what the robust loss leaves of the closure's pull, or would leave if it were in the
graph, in [0, 1].
"""


class Stage(StrEnum):
    """What became of a loop closure."""

    FOUND = "found"
    """Found by a search while mapping; matches made anew take its place in the end."""
    FINAL = "final"
    """In the finished graph."""
    REJECTED = "rejected"
    """Taken out of the graph in the end, because the rest contradicted it."""


def nodes_csv(result: Result) -> str:
    """Return which scan each node is and which submaps it was inserted into, one row a node."""
    graph = result.graph
    submaps: list[list[int]] = [[] for _ in range(graph.num_nodes)]
    own = graph.kinds == ConstraintKind.INTRA_SUBMAP
    for submap, node in zip(graph.index_a[own].tolist(), graph.index_b[own].tolist(), strict=True):
        submaps[node].append(submap)
    stamps = result.stamps[result.node_scan_index].tolist()
    lines = [",".join(NODE_COLUMNS)]
    lines += [
        f"{node},{format_stamp(stamp)},{' '.join(map(str, sorted(submaps[node])))}"
        for node, stamp in enumerate(stamps)
    ]
    return "\n".join(lines) + "\n"


def closures_csv(result: Result) -> str:
    """Return all loop closures of a run: in each stage in the order in which they came about."""
    graph = result.graph
    final = closures_in(graph, graph.kinds == ConstraintKind.LOOP_CLOSURE)
    adjustment = result.config.global_slam.pose_adjustment
    lines = [",".join(CLOSURE_COLUMNS)]
    for stage, closures in (
        (Stage.FOUND, result.found),
        (Stage.FINAL, final),
        (Stage.REJECTED, result.rejected),
    ):
        lines += _rows(stage, closures, graph, adjustment)
    return "\n".join(lines) + "\n"


def _rows(
    stage: Stage, closures: Closures, graph: PoseGraph, config: PoseAdjustmentConfig
) -> list[str]:
    error = closures["tf_submap_node"] - relative_all(
        graph.submap_poses[closures["submap"]], graph.node_poses[closures["node"]]
    )
    error[:, 2] = wrap_angles(error[:, 2])
    squared = np.maximum(np.einsum("ni,nij,nj->n", error, closures["information"], error), 0.0)
    columns = (
        closures["submap"],
        closures["node"],
        *closures["tf_submap_node"].T,
        closures["score"],
        closures["runner_up"],
        np.hypot(error[:, 0], error[:, 1]),
        np.degrees(np.abs(error[:, 2])),
        loss_weights(squared, config.loss, config.loss_scale),
    )
    return [
        f"{stage},{submap},{node},{x!r},{y!r},{theta!r},"
        f"{_number(score)},{_number(runner_up)},{metres!r},{degrees!r},{weight!r}"
        for submap, node, x, y, theta, score, runner_up, metres, degrees, weight in zip(
            *(column.tolist() for column in columns), strict=True
        )
    ]


def _number(value: float) -> str:
    """Return the shortest text that reads back as the same number, nothing for NaN."""
    return "" if math.isnan(value) else repr(value)
