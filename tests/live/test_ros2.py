# SPDX-License-Identifier: Apache-2.0
"""Topics of ROS 2: a publisher in another process, on loopback, without ROS."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from threading import Event, Thread

import pytest

from cartoloop.errors import InputError
from cartoloop.live.notices import Notices
from cartoloop.live.ros2 import (
    DEPTH,
    LOOPBACK_ONLY,
    RawMessage,
    Ros2Source,
    sensor_messages,
)
from cartoloop.sensor.events import LaserScan, Odometry
from tests.limits import LIMIT_S, wait_until

ROOT = Path(__file__).parents[2]
needs_dds = pytest.mark.skipif(
    importlib.util.find_spec("cyclonedds") is None,
    reason="cyclonedds is not installed: pip install 'cartoloop[dds]'",
)


@needs_dds
def test_a_robots_topics_are_received(monkeypatch):
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK_ONLY)
    domain = 100 + os.getpid() % 100
    source = Ros2Source(domain)
    received, reported = [], []
    stop = Event()
    assert source.open() == f"waiting for topics of ROS 2 in domain {domain}"
    receiver = Thread(target=source.run, args=(received.append, Notices(reported.append), stop))
    receiver.start()
    try:
        paths = [str(ROOT / "src"), str(ROOT), os.environ.get("PYTHONPATH", "")]
        publisher = subprocess.run(
            [sys.executable, "-m", "tests.live.publish_ros2", str(domain), "6"],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            check=False,
        )
        assert publisher.returncode == 0, publisher.stderr
        wait_until(lambda: len(received) >= 50)
    finally:
        stop.set()
        receiver.join(LIMIT_S)

    scans = [message for message in received if isinstance(message, LaserScan)]
    odometry = [message for message in received if isinstance(message, Odometry)]
    subscribed = [line for line in reported if line.endswith(")")]
    assert sorted(subscribed) == ["/odom (Odometry)", "/scan (LaserScan)"]
    assert 25 <= len(scans) <= 31
    assert 25 <= len(odometry) <= 31
    geometry = scans[0].geometry
    assert geometry.tf_tracking_sensor == (0.25, 0.0, 0.0)
    assert geometry.num_beams == len(scans[0].ranges) == 361
    assert geometry.range_max == 30.0
    assert scans[-1].stamp == pytest.approx(odometry[-1].stamp, abs=0.3)


@pytest.mark.skipif(
    importlib.util.find_spec("cyclonedds") is not None, reason="cyclonedds is installed"
)
def test_without_the_extra_the_message_names_it():
    with pytest.raises(InputError, match=r"pip install 'cartoloop\[dds\]'"):
        Ros2Source(0).open()


def test_the_domain_is_the_users_or_the_environments(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")

    assert Ros2Source().name == "ros2:42"
    assert Ros2Source(7).name == "ros2:7"


class Reader:
    """Holds messages, and a notice of another type."""

    def __init__(self, count):
        self.samples = [*[RawMessage(b"scan")] * count, object()]

    def take(self, most):
        taken, self.samples = self.samples[:most], self.samples[most:]
        return taken


@pytest.mark.parametrize(("count", "reported"), [(DEPTH - 1, 0), (DEPTH, 1)])
def test_a_reader_that_is_full_may_have_lost_messages(count, reported):
    lines = []

    messages = sensor_messages("/scan", Reader(count), Notices(lines.append))

    assert len(messages) == count
    assert len(lines) == reported
