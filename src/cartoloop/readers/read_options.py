# SPDX-License-Identifier: Apache-2.0
"""Facts about a recording that the user states because it lacks them or has them wrong."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from cartoloop.sensor.pose import Pose

NO_TOPIC = "none"
"""In place of a topic: map without this sensor."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How to read recordings; by default everything is determined from the recording.

    Attributes
    ----------
    scan_topics : of a bag: the scanners to map with; by default all that are level.
    odom_topic, imu_topic : of a bag; ``none`` to map without.
    urdf : the robot's description, with the mounting poses of its sensors.
    laser_pose : mounting pose of the (first) scanner; overrides all that is recorded.
    echo : which echo of scanners that send several.
    """

    scan_topics: tuple[str, ...] = ()
    odom_topic: str | None = None
    imu_topic: str | None = None
    urdf: Path | None = None
    laser_pose: Pose | None = None
    echo: Literal["first", "strongest"] = "first"

    @property
    def bag_only(self) -> list[str]:
        """Command-line names of the options in use that apply to bags only."""
        used = {
            "--scan-topic": self.scan_topics,
            "--odom-topic": self.odom_topic,
            "--imu-topic": self.imu_topic,
            "--urdf": self.urdf,
            "--echo": self.echo != "first",
        }
        return [name for name, value in used.items() if value]
