# SPDX-License-Identifier: Apache-2.0
"""The details of one loop closure, for the operator to judge it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.sensor.pose import Pose, relative, wrap_angle
from cartoloop.viewer.protocol import REJECTED, ConstraintRows

CLOSURES = (ConstraintKind.LOOP_CLOSURE, REJECTED)


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
    other, tf_submap_other = _nearest_own_node(rows, submap, measured)
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
        "other_node": other,
        "tf_submap_other": tf_submap_other,
        "other_points": [] if other is None else _points(node_points, other),
    }


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


def _nearest_own_node(
    rows: ConstraintRows, submap: int, tf_submap_node: Pose
) -> tuple[int | None, list[float] | None]:
    """Return the nearest node that was inserted into the submap, and its pose there."""
    own = np.flatnonzero((rows.kinds == ConstraintKind.INTRA_SUBMAP) & (rows.index_a == submap))
    if len(own) == 0:
        return None, None
    offset = rows.relative_poses[own, :2] - np.array(tf_submap_node[:2], np.float32)
    nearest = own[np.argmin(np.hypot(offset[:, 0], offset[:, 1]))]
    return int(rows.index_b[nearest]), rows.relative_poses[nearest].tolist()


def _points(node_points: Sequence[FloatArray], node: int) -> list[list[float]]:
    if node >= len(node_points):
        return []
    points: list[list[float]] = np.round(node_points[node], 3).tolist()
    return points


def _or_null(value: float) -> float | None:
    return value if math.isfinite(value) else None
