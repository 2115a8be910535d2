# SPDX-License-Identifier: Apache-2.0
"""Composite scans: every few metres, the returns of some metres of path in one frame."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import AdaptiveVoxelFilterConfig, WideSearchConfig
from cartoloop.global_slam.composite_scans import CompositeScans
from cartoloop.global_slam.submap_paths import LOST_M
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
    scans, _ = drive(20, min_num_scans=1)
    in_local = transform_points(pose(16), scans.points[0])
    assert len(in_local) == 5 * len(WALL)
    assert in_local[:, 1] == pytest.approx(2.0)
    assert scans.tf_local_scan[0] == pytest.approx(pose(16))


def test_it_has_a_limited_number_of_scans():
    scans, _ = drive(20, max_num_scans=2)
    assert len(scans.points[0]) == 2 * len(WALL)


def test_sparse_scans_come_from_a_longer_path():
    scans, _ = drive(20, min_num_scans=9)
    assert len(scans.points[0]) == 9 * len(WALL)


def test_that_path_has_a_largest_length():
    scans, _ = drive(20, min_num_scans=9, max_length=1.5)
    assert len(scans.points[0]) == 7 * len(WALL)


def test_sparse_scans_of_another_session_are_left_out():
    scans = CompositeScans(WideSearchConfig(adaptive_voxel_filter=UNFILTERED))
    points = ScanPoints.of([WALL] * 14)
    for node in range(14):
        if node == 6:
            scans.begin_session()
        scans.add_node(Pose(1.0 * node, 0.0, 0.0), points)
    assert scans.nodes.tolist() == [4, 10]
    assert [len(scans.points[number]) // len(WALL) for number in range(2)] == [5, 5]


def test_scans_before_a_gap_are_left_out():
    scans = CompositeScans(WideSearchConfig(adaptive_voxel_filter=UNFILTERED))
    points = ScanPoints.of([WALL] * 14)
    for node in range(14):
        scans.add_node(Pose(1.0 * node, 0.0, 0.0), points, was_lost=node == 6)
    assert scans.nodes.tolist() == [4, 10]
    assert [len(scans.points[number]) // len(WALL) for number in range(2)] == [5, 5]
    assert scans.travelled[1] - scans.travelled[0] == pytest.approx(LOST_M + 5.0)


def test_a_robot_at_rest_makes_none():
    scans = CompositeScans(WideSearchConfig())
    points = ScanPoints.of([WALL] * 50)
    assert [scans.add_node(Pose(0.0, 0.0, 0.0), points) for _ in range(50)] == [None] * 50
