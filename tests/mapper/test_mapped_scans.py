# SPDX-License-Identifier: Apache-2.0
"""The scans of a map that grows."""

import math

import numpy as np
import pytest

from cartoloop.earlier_sessions import EarlierMaps
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.mapped_scans import MappedScans
from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.pose import Pose

GEOMETRY = ScanGeometry(
    sensor="front",
    num_beams=3,
    angle_min=-1.0,
    angle_increment=1.0,
    range_min=0.1,
    range_max=10.0,
)


def add(scans, stamp, *, is_node=False):
    scan = LaserScan(stamp, stamp - 100.0, np.ones(3), GEOMETRY)
    scans.add(scan, Pose(stamp, 0.5, 0.1), is_node=is_node)


@pytest.fixture
def scans():
    """Four scans, the second and the last of them nodes."""
    scans = MappedScans(EarlierMaps())
    for stamp in (101.0, 102.0, 103.0, 104.0):
        add(scans, stamp, is_node=stamp in (102.0, 104.0))
    return scans


def test_without_scans_there_is_no_stamp():
    scans = MappedScans(EarlierMaps())
    assert (len(scans), scans.num_nodes, scans.has_own) == (0, 0, False)
    assert math.isnan(scans.last_stamp)


def test_scans_keep_their_stamps_and_poses(scans):
    stamps, poses = scans.rows(3)
    assert stamps.tolist() == [101.0, 102.0, 103.0]
    assert poses.tolist() == [[stamp, 0.5, 0.1] for stamp in stamps.tolist()]
    assert (len(scans), scans.last_stamp) == (4, 104.0)


def test_nodes_are_some_of_the_scans(scans):
    assert scans.num_nodes == 2
    assert scans.node_scan_index(2).tolist() == [1, 3]
    assert scans.node_scan_index(1).tolist() == [1]
    assert scans.node_stamps(1, 2).tolist() == [104.0]


def test_what_was_returned_does_not_change(scans):
    stamps, index = scans.node_stamps(0, 2), scans.node_scan_index(2)
    add(scans, 105.0, is_node=True)
    assert (stamps.tolist(), index.tolist()) == ([102.0, 104.0], [1, 3])


def test_the_session_begins_with_its_first_scan(scans):
    session = scans.session(SensorCalibration(OdometryParameters(), {}))
    assert (session.first_scan, session.first_node, session.first_submap) == (0, 0, 0)
    assert session.stamp == 101.0


def test_each_scanner_is_reported_once(scans):
    [sensor] = scans.sensors()
    assert sensor["beams"] == 3
