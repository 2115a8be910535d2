# SPDX-License-Identifier: Apache-2.0
"""What a user may say about a recording that it does not say itself, or says wrong."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from cartoloop.sensor.pose import Pose

NO_TOPIC = "none"


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How to read recordings; the defaults find out everything.

    Attributes
    ----------
    scan_topics : of a bag: the scanners to map with; by default all that lie level.
    odom_topic, imu_topic : of a bag; ``none`` for going without.
    urdf : the robot's description, which tells where its sensors sit.
    laser_pose : where the (first) scanner sits on the robot; comes before all that is recorded.
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
        """Command-line names of the options in use that make sense for bags alone."""
        used = {
            "--scan-topic": self.scan_topics,
            "--odom-topic": self.odom_topic,
            "--imu-topic": self.imu_topic,
            "--urdf": self.urdf,
            "--echo": self.echo != "first",
        }
        return [name for name, value in used.items() if value]
