# SPDX-License-Identifier: Apache-2.0
"""Publishes a drive as a robot with ROS 2 would: ``python publish_ros2.py DOMAIN DURATION``."""

from __future__ import annotations

import math
import sys
import time

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from cartoloop.live import dds_types as dds
from cartoloop.sensor.events import LaserScan
from tests.live.live_room import drive

SENSOR = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(5))
FIXED = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(1),
)


def header(stamp, frame):
    return dds.Header(dds.Time(int(stamp), int(1e9 * (stamp % 1.0))), frame)


def scan_message(scan):
    geometry = scan.geometry
    last = geometry.angle_min + geometry.angle_increment * (geometry.num_beams - 1)
    return dds.LaserScan(
        header(scan.stamp, "laser"),
        geometry.angle_min, last, geometry.angle_increment, 0.0, 0.2, 0.1, 30.0,
        [r if r < 30.0 else math.inf for r in scan.ranges.tolist()], [],
    )  # fmt: skip


def odometry_message(odometry):
    message = dds.Odometry(header(odometry.stamp, "odom"), "base_link")
    x, y, theta = odometry.tf_odom_tracking
    message.pose.pose.position = dds.Point(x, y, 0.0)
    message.pose.pose.orientation = dds.Quaternion(
        0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2)
    )
    return message


def main(domain, seconds):
    participant = DomainParticipant(domain)

    def writer(topic, datatype, qos):
        return DataWriter(participant, Topic(participant, topic, datatype, qos=qos), qos=qos)

    scans = writer("rt/scan", dds.LaserScan, SENSOR)
    odometry = writer("rt/odom", dds.Odometry, SENSOR)
    fixed = writer("rt/tf_static", dds.TFMessage, FIXED)
    mount = dds.TransformStamped(header(0.0, "base_link"), "laser")
    mount.transform.translation.x = 0.25
    fixed.write(dds.TFMessage([mount]))
    other = writer("rt/chatter", dds.Time, SENSOR)
    time.sleep(1.0)  # until they have found each other
    for event in drive(seconds).events(with_odometry=True):
        if isinstance(event, LaserScan):
            scans.write(scan_message(event))
            time.sleep(0.01)
        else:
            odometry.write(odometry_message(event))
            other.write(dds.Time(1, 2))
    time.sleep(0.5)


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
