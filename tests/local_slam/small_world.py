# SPDX-License-Identifier: Apache-2.0
"""A furnished room to drive through, small enough that a test can map it."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.config import Config
from cartoloop.local_slam.local_slam import LocalSlam
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.events import LaserScan, Odometry
from cartoloop.sensor.pose import compose_all, relative_all
from cartoloop.simulation import FloorPlan, Lidar, World, simulate

LIDAR = Lidar(num_beams=541, angle_min=math.radians(-135.0), angle_increment=math.radians(0.5))


def furnished_room():
    """A room of 9 x 7 m with a cupboard, a pillar and a table, and a route around it."""
    plan = FloorPlan()
    for start, end in (((0, 0), (9, 0)), ((9, 0), (9, 7)), ((0, 7), (9, 7)), ((0, 0), (0, 7))):
        plan.wall(start, end)
    plan.box((0.0, 2.5), (0.6, 4.0))
    plan.box((6.5, 6.3), (8.0, 7.0))
    plan.pillar((4.5, 3.5), 0.3)
    plan.pillar((2.0, 5.8), 0.4)
    route = [(1.8, 1.5), (7.2, 1.5), (7.2, 5.2), (3.0, 5.0), (1.8, 1.8)]
    return World("furnished room", plan.segments(), np.array(route))


def record(odometry=None, duration=20.0, seed=5):
    return simulate(furnished_room(), LIDAR, odometry, seed=seed, duration=duration)


def local_slam(config, known=None):
    node_filter = config.global_slam.constraint_search.adaptive_voxel_filter
    return LocalSlam(config.local_slam, config.sensor, node_filter, StageTimer(), known)


def run(events, config=None):
    """Run local SLAM over events: the poses of all scans, shape (n, 3), the results, the SLAM."""
    slam = local_slam(config or Config())
    results = []
    for event in events:
        if isinstance(event, Odometry):
            slam.add_odometry(event)
        elif isinstance(event, LaserScan):
            results.append(slam.add_scan(event))
        else:
            slam.add_imu(event)
    poses = np.array([result.tf_local_tracking for result in results]).reshape(-1, 3)
    return poses, results, slam


def errors(poses, truth, anchor=0):
    """Distance [m] and angle [rad] of each pose from the truth, aligned at the pose `anchor`."""
    in_map = compose_all(truth[anchor], relative_all(poses[anchor], poses))
    off = relative_all(truth, in_map)
    return np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])
