# SPDX-License-Identifier: Apache-2.0
"""The details of one loop closure, for the operator to judge it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.sensor.pose import Pose, relative, transform_points, wrap_angle
from cartoloop.viewer.protocol import REJECTED, ConstraintRows

CLOSURES = (ConstraintKind.LOOP_CLOSURE, REJECTED)

_NEAR_M = 0.15
"""Returns of two scans so near are of the same wall, about [m]."""

_STRIDE = 1 << 24
"""Cells in a row, more than any scan reaches."""


def closure_details(
    constraint: int,
    rows: ConstraintRows,
    tf_map_submaps: FloatArray,
    tf_map_nodes: FloatArray,
    node_points: Sequence[FloatArray],
    closures: Closures,
) -> dict[str, Any]:
    """Return the content of a CLOSURE message.

    Parameters
    ----------
    constraint : row of a loop closure, rejected or not.
    rows : all constraints.
    tf_map_submaps, tf_map_nodes : float64 (m, 3), (n, 3), present poses.
    node_points : of each node [m], node frame.
    closures : the record of closures.

    Raises
    ------
    LookupError
        That row is no loop closure, or its ends are not known yet.
    """
    if constraint >= len(rows.kinds) or rows.kinds[constraint] not in CLOSURES:
        raise LookupError(f"constraint {constraint} is no loop closure")
    submap, node = int(rows.index_a[constraint]), int(rows.index_b[constraint])
    if submap >= len(tf_map_submaps) or node >= len(tf_map_nodes):
        raise LookupError(f"the ends of constraint {constraint} are not known yet")
    tf_map_submap = Pose(*tf_map_submaps[submap].tolist())
    tf_map_node = Pose(*tf_map_nodes[node].tolist())
    measured = Pose(*rows.relative_poses[constraint].tolist())
    expected = relative(tf_map_submap, tf_map_node)
    other = _most_alike(rows, submap, measured, node, node_points)
    return _from_record(closures, int(rows.closures[constraint])) | {
        "constraint": constraint,
        "submap": submap,
        "node": node,
        "residual_m": math.hypot(measured.x - expected.x, measured.y - expected.y),
        "residual_deg": math.degrees(abs(wrap_angle(measured.theta - expected.theta))),
        "tf_submap_node": list(measured),
        "tf_map_submap": list(tf_map_submap),
        "tf_map_node": list(tf_map_node),
        "points": _points(node_points, node),
        "other_node": None if other is None else other.node,
        "tf_submap_other": None if other is None else other.tf_submap_node,
        "other_points": [] if other is None else _points(node_points, other.node),
        "overlap": None if other is None else other.overlap,
    }


def closure_list(rows: ConstraintRows, closures: Closures) -> dict[str, Any]:
    """Return the content of a CLOSURES message: what the record holds of all closures, by column.

    Parameters
    ----------
    rows : all constraints.
    closures : the record of closures.
    """
    found = np.flatnonzero(np.isin(rows.kinds, CLOSURES))
    record = rows.closures[found]
    reasons = closures.reason[record]
    return {
        "constraint": found.tolist(),
        "score": _column(closures.score[record]),
        "fit_residual": _column(closures.residual[record]),
        "reason": reasons.tolist(),
        "reasons": {str(code): Reason(code).text for code in np.unique(reasons).tolist()},
    }


def _column(values: FloatArray) -> list[float | None]:
    return [_or_null(value) for value in np.round(values, 3).tolist()]


def _from_record(closures: Closures, row: int) -> dict[str, Any]:
    """Return what the record of closures holds of a pair, null where there is no value."""
    was_requested = row < closures.num_requested
    moved_m, moved_rad = closures.moved[row].tolist()
    return {
        "status": Status(closures.status[row]).text,
        "reason": Reason(closures.reason[row]).text,
        "min_score": _or_null(float(closures.min_score[row])) if was_requested else None,
        "score": _or_null(float(closures.score[row])),
        "runner_up": _or_null(float(closures.runner_up[row])),
        "fit_residual": _or_null(float(closures.residual[row])),
        "moved_m": _or_null(moved_m),
        "moved_deg": _or_null(math.degrees(moved_rad)),
        "window": {
            "tf_submap_node": closures.predicted[row].tolist(),
            "linear_m": float(closures.linear_window[row]),
            "angular_rad": float(closures.angular_window[row]),
        }
        if was_requested
        else None,
    }


class _Other(NamedTuple):
    """A node of the submap itself, and the share of the closure's returns that it saw as well."""

    node: int
    tf_submap_node: list[float]
    overlap: float


def _most_alike(
    rows: ConstraintRows,
    submap: int,
    tf_submap_node: Pose,
    node: int,
    node_points: Sequence[FloatArray],
) -> _Other | None:
    """Return the node inserted into the submap that saw most of what another node sees there.

    The nearest in position may look into another direction: then the two scans show nothing of how
    well they fit.
    """
    own = np.flatnonzero((rows.kinds == ConstraintKind.INTRA_SUBMAP) & (rows.index_a == submap))
    own = own[(rows.index_b[own] < len(node_points)) & (rows.index_b[own] != node)]
    if len(own) == 0 or node >= len(node_points):
        return None
    cells = _cells(transform_points(tf_submap_node, node_points[node]))
    seen = _near(cells)
    most, best = -1.0, None
    for row in own.tolist():
        other = int(rows.index_b[row])
        pose = rows.relative_poses[row].tolist()
        points = transform_points(Pose(*pose), node_points[other])
        shared = int(np.count_nonzero(np.isin(_cells(points), seen)))
        alike = shared / max(len(points), len(cells), 1)
        if alike > most:
            overlap = float(np.isin(cells, _near(_cells(points))).mean()) if len(cells) else 0.0
            most, best = alike, _Other(other, pose, round(overlap, 3))
    return best


def _cells(points: FloatArray) -> IntArray:
    """Return the cell in which each of some points lies, as one number."""
    cells: IntArray = np.floor(points / _NEAR_M).astype(np.int64)
    return cells[:, 0] * _STRIDE + cells[:, 1]


def _near(cells: IntArray) -> IntArray:
    """Return cells and the eight around each."""
    around = [row * _STRIDE + col for row in (-1, 0, 1) for col in (-1, 0, 1)]
    return np.unique(cells[:, np.newaxis] + np.array(around))


def _points(node_points: Sequence[FloatArray], node: int) -> list[list[float]]:
    if node >= len(node_points):
        return []
    points: list[list[float]] = np.round(node_points[node], 3).tolist()
    return points


def _or_null(value: float) -> float | None:
    return value if math.isfinite(value) else None
