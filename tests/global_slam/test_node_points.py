# SPDX-License-Identifier: Apache-2.0
"""The returns of ever more nodes."""

from __future__ import annotations

import numpy as np

from cartoloop.global_slam.node_points import NodePoints

SCANS = [np.random.default_rng(k).uniform(-9.0, 9.0, (k, 2)) for k in (3, 0, 5)]


def test_what_was_seen_of_the_nodes_stays_while_others_are_added():
    nodes = NodePoints()
    views = []
    for count in range(40):
        views.append(nodes.view)
        nodes.append(SCANS[count % 3])
    for count, view in enumerate(views):
        assert len(view) == count
        for k, points in enumerate(view):
            np.testing.assert_array_equal(points, SCANS[k % 3])
