# SPDX-License-Identifier: Apache-2.0
"""By how much scans change from one node to another."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.kernels.outline_distance import count_apart
from cartoloop.quality.pairs import MapContent
from cartoloop.sensor.free_standing import are_free_standing
from cartoloop.sensor.pose import Pose, relative, transform_points

CHANGED_M = 0.3
"""A return this far from the outline that another scan sees has moved [m]."""

MAX_EDGE_M = 2.0
"""Neighbouring returns further apart do not belong to one wall [m]."""

USUAL_SAMPLES = 100
"""Nodes at which it is measured what usually changes."""


def usual_change(content: MapContent) -> float:
    """Return the share of the returns that changes from node to node wherever the robot is.

    Outliers and noise change them, not only motion: a quarter of the map has less.
    """
    count = len(content.node_points) - 1
    if count < 1:
        return 0.0
    nodes = np.unique(np.linspace(0, count - 1, min(count, USUAL_SAMPLES)).astype(np.int64))
    return float(np.quantile([changed_share(content, n, n + 1) for n in nodes.tolist()], 0.25))


def changed_share(
    content: MapContent, one: int, other: int, max_range: float = 12.0, *, of_people: bool = True
) -> float:
    """Return the share of a node's returns that are not on the outline that another node sees.

    Of those to which that one has looked.

    Parameters
    ----------
    of_people : whether narrow objects that stand free count, as people do, and what was hidden by
        them. Where they walk around a robot that stands, nothing else changes; around one that
        moves, walls do.
    """
    poses, points = content.graph.node_poses, content.node_points
    outline, seen = points[one], points[other]
    seen = seen[np.hypot(seen[:, 0], seen[:, 1]) < max_range]
    bearings = np.arctan2(outline[:, 1], outline[:, 0])
    order = np.argsort(bearings, kind="stable")
    is_person = np.zeros(len(outline), dtype=np.bool_)
    if not of_people:
        seen, is_person = seen[~_are_people(seen)], _are_people(outline)[order]
    walls = outline[order][~is_person]
    starts, ends = walls[:-1], walls[1:]
    lengths = np.hypot(*(ends - starts).T) if len(starts) else np.zeros(0)
    is_wall = (lengths < MAX_EDGE_M) & (lengths > 1e-6)
    starts, ends = starts[is_wall], ends[is_wall]
    if len(starts) < 5 or len(seen) < 5:
        return 0.0
    pose = relative(Pose(*poses[one].tolist()), Pose(*poses[other].tolist()))
    seen = transform_points(pose, seen)
    directions = np.arctan2(seen[:, 1], seen[:, 0])
    is_seen = _is_in_view(directions, bearings[order])
    seen = seen[is_seen & ~_is_hidden(directions, bearings[order], is_person)]
    if len(seen) < 5:
        return 0.0
    return num_changed(seen, starts, ends) / len(seen)


def num_changed(points: FloatArray, starts: FloatArray, ends: FloatArray) -> int:
    """Return how many returns are not on an outline.

    Parameters
    ----------
    points : float64, shape (n, 2) [m].
    starts, ends : float64, shapes (k, 2), of its edges, which have a length [m].
    """
    return count_apart(points, starts, ends, CHANGED_M)


def _is_in_view(bearings: FloatArray, outline: FloatArray) -> BoolArray:
    """Return which bearings are within those of an outline [rad], which ascend."""
    gaps = np.diff(outline, append=outline[0] + math.tau)
    widest = int(np.argmax(gaps))
    begin = outline[(widest + 1) % len(outline)]
    is_seen: BoolArray = np.mod(bearings - begin, math.tau) <= math.tau - gaps[widest]
    return is_seen


def _are_people(points: FloatArray) -> BoolArray:
    """Return which returns are on narrow objects that stand free, or are hidden by others."""
    return are_free_standing(np.ascontiguousarray(points, dtype=np.float64), also_hidden=True)


def _is_hidden(bearings: FloatArray, outline: FloatArray, is_hiding: BoolArray) -> BoolArray:
    """Return which bearings are beside those of an outline that hide what is behind [rad].

    Parameters
    ----------
    outline : bearings, which ascend.
    is_hiding : which of them hide something.
    """
    after = np.searchsorted(outline, bearings)
    hidden: BoolArray = is_hiding[after % len(outline)] | is_hiding[after - 1]
    return hidden
