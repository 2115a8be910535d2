# SPDX-License-Identifier: Apache-2.0
"""Loop closures, and requests for them, made by hand."""

from __future__ import annotations

import numpy as np

from cartoloop.global_slam.loop_closure import CLOSURE, NO_CLOSURES, REQUEST


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


def requests(*pairs):
    """Requests for pairs of submap and node."""
    each = np.zeros(len(pairs), REQUEST)
    for one, (submap, node) in zip(each, pairs, strict=True):
        one["submap"], one["node"], one["node_submap"] = submap, node, node
    each["linear_window"], each["angular_window"] = 1.0, 0.1
    return each
