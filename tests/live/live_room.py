# SPDX-License-Identifier: Apache-2.0
"""A drive through a corridor as the messages that a robot would send."""

from __future__ import annotations

import json

import numpy as np

from cartoloop.sensor.events import LaserScan
from cartoloop.simulation import corridor, simulate


def drive(duration=10.0, seed=1):
    """Return the simulated drive."""
    return simulate(corridor(), seed=seed, duration=duration)


def message_of(event):
    """Return an event as a message."""
    if isinstance(event, LaserScan):
        geometry = event.geometry
        return {
            "type": "scan",
            "stamp": event.stamp,
            "angle_min": geometry.angle_min,
            "angle_increment": geometry.angle_increment,
            "ranges": np.round(event.ranges, 3).tolist(),
            "pose": list(geometry.tf_tracking_sensor),
        }
    x, y, theta = event.tf_odom_tracking
    return {"type": "odometry", "stamp": event.stamp, "x": x, "y": y, "theta": theta}


def lines(duration=10.0, with_odometry=True):
    """Return the drive as lines of JSON."""
    events = drive(duration).events(with_odometry=with_odometry)
    return [json.dumps(message_of(event)).encode() + b"\n" for event in events]
