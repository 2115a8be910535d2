# SPDX-License-Identifier: Apache-2.0
"""A robot with ROS 2: topics over DDS, without ROS; needs the extra ``dds``."""

from __future__ import annotations

import math
import os
import time
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from bench.soak.senders import Sender, Silent
from cartoloop.live import dds_types as dds
from cartoloop.live.ros2 import DEPTH, LOOPBACK_ONLY, Ros2Source
from cartoloop.live.source import Source
from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent

SENSOR = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(5))
FIXED = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(1),
)

_MATCH_S = 60.0
"""Time for a publisher and the source to find each other [s]."""

_TICK_S = 0.01
_FIRST_DOMAIN, _NUM_DOMAINS = 100, 100


class DdsSender:
    """A participant with a scanner, odometry and the fixed transform of the scanner."""

    def __init__(self, domain: int) -> None:
        self._participant = DomainParticipant(domain)
        self._fixed = self._writer("rt/tf_static", dds.TFMessage, FIXED)
        mount = dds.TransformStamped(header(0.0, "base_link"), "laser")
        self._fixed.write(dds.TFMessage([mount]))
        self._scans = self._writer("rt/scan", dds.LaserScan, SENSOR)
        self._odometry = self._writer("rt/odom", dds.Odometry, SENSOR)
        deadline = time.monotonic() + _MATCH_S
        for writer in (self._fixed, self._scans, self._odometry):
            while not writer.get_matched_subscriptions():
                if time.monotonic() > deadline:
                    raise TimeoutError("the source does not subscribe to the topics")
                time.sleep(_TICK_S)

    def _writer(self, topic: str, datatype: Any, qos: Qos) -> Any:  # noqa: ANN401
        described = Topic(self._participant, topic, datatype, qos=qos)
        return DataWriter(self._participant, described, qos=qos)

    def send(self, event: SensorEvent, stamp: float) -> None:
        """Publish a message."""
        if isinstance(event, LaserScan):
            self._scans.write(scan_message(event, stamp))
        else:
            assert isinstance(event, Odometry)
            self._odometry.write(odometry_message(event, stamp))

    def flood(self, count: int) -> int:
        """Publish messages of a type that nobody reads."""
        other = self._writer("rt/chatter", dds.Time, SENSOR)
        for _ in range(count):
            other.write(dds.Time(1, 2))
        return 0

    def send_garbage(self, data: bytes) -> int:
        """Publish a scan of zero width."""
        ranges = [float(value) for value in data[:181]]
        bad = dds.LaserScan(
            header(0.0, "laser"), math.nan, math.nan, 0.0, 0.0, 0.2, 0.1, 30.0, ranges, []
        )
        self._scans.write(bad)
        return 1

    def break_off(self) -> int:
        """Leave the domain: a message is whole or nothing."""
        self.close()
        return 0

    def cut(self) -> None:
        """Leave the domain."""
        self.close()

    def close(self) -> None:
        """Leave the domain."""
        del self._scans, self._odometry, self._fixed, self._participant

    def end(self) -> None:
        """Leave the domain; the silence ends the day."""
        self.close()


class _SilentParticipant:
    """Joins the domain and publishes nothing."""

    def __init__(self, domain: int) -> None:
        self._participant: DomainParticipant | None = DomainParticipant(domain)

    def close(self) -> None:
        """Leave the domain."""
        self._participant = None


class DdsNetwork:
    """The source of a domain on this machine, and publishers in it."""

    max_ahead = DEPTH // 2
    end_after = 10.0

    def __init__(self) -> None:
        os.environ.setdefault("CYCLONEDDS_URI", LOOPBACK_ONLY)
        self._domain = _FIRST_DOMAIN + os.getpid() % _NUM_DOMAINS
        self._source = Ros2Source(self._domain)

    @property
    def source(self) -> Source:
        """The source."""
        return self._source

    def connect(self) -> Sender:
        """Return a publisher that the source has found."""
        return DdsSender(self._domain)

    def connect_silent(self) -> Silent:
        """Return a participant that publishes nothing."""
        return _SilentParticipant(self._domain)


def header(stamp: float, frame: str) -> dds.Header:
    """Return the header of a message."""
    nanoseconds = round(1e9 * stamp)
    return dds.Header(dds.Time(nanoseconds // 10**9, nanoseconds % 10**9), frame)


def scan_message(scan: LaserScan, stamp: float) -> dds.LaserScan:
    """Return a scan as its driver publishes it."""
    geometry = scan.geometry
    last = geometry.angle_min + geometry.angle_increment * (geometry.num_beams - 1)
    return dds.LaserScan(
        header(stamp, "laser"),
        geometry.angle_min, last, geometry.angle_increment, 0.0, 0.2, 0.1, 30.0,
        [r if r < 30.0 else math.inf for r in scan.ranges.tolist()], [],
    )  # fmt: skip


def odometry_message(odometry: Odometry, stamp: float) -> dds.Odometry:
    """Return a reading as the base publishes it."""
    message = dds.Odometry(header(stamp, "odom"), "base_link")
    x, y, theta = odometry.tf_odom_tracking
    message.pose.pose.position = dds.Point(x, y, 0.0)
    message.pose.pose.orientation = dds.Quaternion(
        0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2)
    )
    return message
