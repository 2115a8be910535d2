# SPDX-License-Identifier: Apache-2.0
"""Where the drift may place a node: submaps in reach, and the search window in each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.submap_paths import FAR_M, SubmapPaths
from cartoloop.kernels.due_pairs import NodePlace
from cartoloop.kernels.wide_windows import WindowRule, drift_windows


class Reach(NamedTuple):
    """The submaps where a node may be.

    Attributes
    ----------
    due : int64, shape (k,), the submaps, ascending.
    tf_submap_node : float64, shape (k, 3), the windows' centres: where the graph expects the node;
        the middle of the submap where it may be anywhere.
    linear_window, angular_window : shape (k,), what the drift allows around it [m], [rad].
    """

    due: IntArray
    tf_submap_node: FloatArray
    linear_window: FloatArray
    angular_window: FloatArray


def bounding_boxes(submaps: Sequence[FinishedSubmap]) -> FloatArray:
    """Return x and y of the least and greatest corner of the grids, submap frame, (n, 4) [m]."""
    return np.array(
        [
            (
                grid.origin_x,
                grid.origin_y,
                grid.origin_x + grid.shape[1] * grid.resolution,
                grid.origin_y + grid.shape[0] * grid.resolution,
            )
            for grid in (submap.grid for submap in submaps)
        ]
    ).reshape(-1, 4)


def wide_reach(
    config: ConstraintSearchConfig,
    paths: SubmapPaths,
    place: NodePlace,
    submap_poses: FloatArray,
    submap_travelled: FloatArray,
    boxes: FloatArray,
    min_path_length: float | None = None,
) -> Reach:
    """Return the submaps with a long path to a node in which its window lies.

    Parameters
    ----------
    paths : between the submaps.
    place : of the node.
    submap_poses : shape (m, 3), of the submaps that `paths` knows.
    submap_travelled : path length when each was begun [m].
    boxes : shape (n, 4), of the first submaps, which are finished; n <= m.
    min_path_length : of these paths [m]; None: that of wide searches.
    """
    wide, count = config.wide_search, len(boxes)
    anchor, step = place.anchor, place.anchor_length
    if anchor >= len(paths):
        anchor = len(paths) - 1
        step = abs(place.travelled - float(submap_travelled[anchor]))
    lengths = np.minimum(
        paths.lengths_from(anchor)[:count] + step,
        np.abs(place.travelled - submap_travelled[:count]),
    )
    least = wide.min_path_length if min_path_length is None else min_path_length
    far = np.flatnonzero((lengths >= least) & (lengths < FAR_M))
    if len(far) == 0:
        return _nowhere()
    windows = np.empty((len(far), 6))
    num_in_reach = drift_windows(
        far,
        paths.drift_from(anchor, submap_poses[:, :2]),
        (place.x, place.y, place.theta),
        submap_poses,
        boxes,
        _window_rule(config, step)[:],
        windows,
    )
    if num_in_reach == 0:
        return _nowhere()
    nearest = np.argsort(windows[:, 5], kind="stable")[:num_in_reach]
    chosen = np.sort(nearest[: wide.max_submaps])
    due, windows = far[chosen], windows[chosen]
    return _within_boxes(
        Reach(due, windows[:, :3], windows[:, 3], np.minimum(windows[:, 4], math.pi)),
        boxes[due, :2],
        boxes[due, 2:],
    )


def _nowhere() -> Reach:
    """Return no submap."""
    return Reach(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros(0))


def _window_rule(config: ConstraintSearchConfig, step: float) -> WindowRule:
    """Return how large windows are; `step`: path length from the node to its anchor [m]."""
    wide = config.wide_search
    return WindowRule(
        wide.num_sigmas,
        config.min_linear_search_window,
        math.radians(config.min_angular_search_window_deg),
        wide.translation_drift**2 * step,
        math.radians(wide.rotation_drift_deg) ** 2 * step,
    )


def _within_boxes(reach: Reach, low: FloatArray, high: FloatArray) -> Reach:
    """Return windows of nodes at any heading that are no larger than the submaps themselves.

    Parameters
    ----------
    low, high : shape (k, 2), corners of the submaps' boxes.
    """
    half = 0.5 * (high - low).max(axis=1, initial=0.0)
    is_whole = (reach.angular_window >= math.pi) & (reach.linear_window > half)
    expected = reach.tf_submap_node.copy()
    expected[is_whole, :2] = 0.5 * (low + high)[is_whole]
    return reach._replace(
        tf_submap_node=expected, linear_window=np.where(is_whole, half, reach.linear_window)
    )
