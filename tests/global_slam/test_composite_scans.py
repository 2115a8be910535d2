# SPDX-License-Identifier: Apache-2.0
"""Composite scans: every few metres, the returns of some metres of path in one frame."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import AdaptiveVoxelFilterConfig, WideSearchConfig
from cartoloop.global_slam.composite_scans import CompositeScans
from cartoloop.sensor.pose import Pose, inverse, transform_points
from cartoloop.sensor.scan_points import ScanPoints

STEP = 0.25
WALL = np.column_stack((np.arange(-5.0, 25.0, 0.5), np.full(60, 2.0)))
"""Seen whole from everywhere [m], local frame."""
UNFILTERED = AdaptiveVoxelFilterConfig(max_length=0.05, min_num_points=10_000, max_range=100.0)


def pose(node):
    return Pose(STEP * node, 0.0, 0.1 * node)


def drive(num_nodes, **changes):
    config = WideSearchConfig(
        **{"spacing": 4.0, "length": 1.0, "adaptive_voxel_filter": UNFILTERED, **changes}
    )
    scans = CompositeScans(config)
    points = ScanPoints.of([transform_points(inverse(pose(k)), WALL) for k in range(num_nodes)])
    return scans, [scans.add_node(pose(node), points) for node in range(num_nodes)]


def test_a_composite_scan_is_made_every_few_metres():
    scans, completed = drive(40)
    assert scans.nodes.tolist() == [16, 32]
    assert [number for number in completed if number is not None] == [0, 1]
    assert scans.travelled == pytest.approx([4.0, 8.0])


def test_its_points_are_in_the_frame_of_the_newest_node():
    scans, _ = drive(20)
    in_local = transform_points(pose(16), scans.points[0])
    assert len(in_local) == 5 * len(WALL)
    assert in_local[:, 1] == pytest.approx(2.0)
    assert scans.tf_local_scan[0] == pytest.approx(pose(16))


def test_it_has_a_limited_number_of_scans():
    scans, _ = drive(20, max_num_scans=2)
    assert len(scans.points[0]) == 2 * len(WALL)


def test_a_robot_at_rest_makes_none():
    scans = CompositeScans(WideSearchConfig())
    points = ScanPoints.of([WALL] * 50)
    assert [scans.add_node(Pose(0.0, 0.0, 0.0), points) for _ in range(50)] == [None] * 50
