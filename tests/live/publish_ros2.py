# SPDX-License-Identifier: Apache-2.0
"""Publishes a drive as a robot with ROS 2 would: ``python publish_ros2.py DOMAIN DURATION``."""

from __future__ import annotations

import sys
import time

from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic

from bench.soak.dds_sender import FIXED, SENSOR, header, odometry_message, scan_message
from cartoloop.live import dds_types as dds
from cartoloop.sensor.events import LaserScan
from tests.limits import wait_until
from tests.live.live_room import drive


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
    wait_until(lambda: all(topic.get_matched_subscriptions() for topic in (scans, odometry)))
    for event in drive(seconds).events(with_odometry=True):
        if isinstance(event, LaserScan):
            scans.write(scan_message(event, event.stamp))
            time.sleep(0.05)  # a busy receiver keeps the last 16
        else:
            odometry.write(odometry_message(event, event.stamp))
            other.write(dds.Time(1, 2))
    time.sleep(0.5)


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
