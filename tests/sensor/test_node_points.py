# SPDX-License-Identifier: Apache-2.0
"""The returns of ever more nodes."""

from __future__ import annotations

import numpy as np

from cartoloop.sensor.scan_points import NodePoints

SCANS = [np.random.default_rng(k).uniform(-9.0, 9.0, (k, 2)) for k in (3, 0, 5)]


def test_a_view_of_the_points_stays_valid_while_nodes_are_added():
    nodes = NodePoints()
    views = []
    for count in range(40):
        views.append(nodes.view)
        nodes.append(SCANS[count % 3])
    for count, view in enumerate(views):
        assert len(view) == count
        for k, points in enumerate(view):
            np.testing.assert_array_equal(points, SCANS[k % 3])
