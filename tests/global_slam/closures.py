# SPDX-License-Identifier: Apache-2.0
"""Requests for closures, and what searches found, made by hand."""

from __future__ import annotations

import numpy as np

from cartoloop.global_slam.closures import Requests, SearchMatches
from cartoloop.global_slam.loop_closure import CLOSURE, NO_CLOSURES

INFORMATION = np.array([(4.0, 1.0, 0.5), (1.0, 5.0, 0.25), (0.5, 0.25, 6.0)])


def requests(*pairs):
    """Requests for pairs of submap and node."""
    submap, node = np.array(pairs, dtype=np.int32).reshape(-1, 2).T
    count = len(pairs)
    return Requests(
        submap, node, node, np.zeros((count, 3)), np.full(count, 1.0), np.full(count, 0.1)
    )


def search_matches(
    rows, poses=(0.0, 0.0, 0.0), *, score=0.9, runner_up=0.0, information=INFORMATION
):
    """What a search found in these rows; one value, or one per row."""
    count = len(rows)
    return SearchMatches(
        row=np.array(rows, dtype=np.int32),
        tf_submap_node=np.array(np.broadcast_to(poses, (count, 3)), dtype=np.float64),
        information=np.array(np.broadcast_to(information, (count, 3, 3))),
        residual=np.full(count, 0.25),
        score=np.array(np.broadcast_to(score, count), dtype=np.float64),
        runner_up=np.array(np.broadcast_to(runner_up, count), dtype=np.float64),
        moved_m=np.full(count, 0.03125),
        moved_rad=np.full(count, 0.015625),
    )


def closure(submap, node, pose=(0.0, 0.0, 0.0), *, score=0.9, runner_up=0.0, information=None):
    """One closure."""
    one = np.zeros(1, CLOSURE)
    one["submap"], one["node"], one["tf_submap_node"] = submap, node, pose
    one["information"] = np.eye(3) if information is None else information
    one["score"], one["runner_up"] = score, runner_up
    return one[0]


def closures(*each):
    """Closures in an array."""
    return np.stack(each) if each else NO_CLOSURES
