# SPDX-License-Identifier: Apache-2.0
"""What is used of a recording, and what the choice of all sensors has in common."""

from __future__ import annotations

from dataclasses import dataclass, field

from cartoloop.errors import InputError
from cartoloop.readers.ros.index import RecordingIndex, Stream
from cartoloop.readers.ros.inventory import BagFinding, Role
from cartoloop.readers.ros.transforms import Pose3

# Parts of names, and how welcome the topic is: the smaller the better.
ODOMETRY_NAMES = {
    "truth": 9, "gt": 9, "map": 6, "slam": 6, "amcl": 6, "gps": 5, "icp": 4, "vio": 4,
    "visual": 4, "lidar": 4, "laser": 4, "filtered": 2, "ekf": 2, "fused": 2, "wheel": -1,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class ScannerChoice:
    """A scanner that is used, and its pose in the base frame."""

    stream: Stream
    tf_base_sensor: Pose3


@dataclass(frozen=True, eq=False)
class OdometryChoice:
    """The odometry that is used; its poses are of a frame in which the base has this pose."""

    stream: Stream
    tf_child_base: Pose3


@dataclass(frozen=True, eq=False)
class ImuChoice:
    """The IMU that is used; its pose in the base frame, and by what its readings are multiplied."""

    stream: Stream
    tf_base_sensor: Pose3
    acceleration_scale: float = 1.0
    velocity_scale: float = 1.0


@dataclass(eq=False)
class Choice:
    """What is used of a recording.

    Attributes
    ----------
    base_frame : the tracking frame.
    scanners : at least one, the main one first; all scanners or all clouds.
    odometry, imu : or None.
    reasons : why each topic is used, or not.
    findings : what is missing or doubtful.
    """

    base_frame: str = ""
    scanners: list[ScannerChoice] = field(default_factory=list)
    odometry: OdometryChoice | None = None
    imu: ImuChoice | None = None
    reasons: dict[str, str] = field(default_factory=dict)
    findings: list[BagFinding] = field(default_factory=list)

    @property
    def streams(self) -> list[Stream]:
        """All that is used, the main scanner first."""
        used = [scanner.stream for scanner in self.scanners]
        used += [self.odometry.stream] if self.odometry else []
        used += [self.imu.stream] if self.imu else []
        return used


def rank(stream: Stream, names: dict[str, int]) -> tuple[int, int, str]:
    """Return a key by which the most welcome stream comes first."""
    text = f"{stream.topic} {stream.frame}".lower()
    return (sum(n for part, n in names.items() if part in text), -len(stream.stamps), stream.topic)


def asked_for(index: RecordingIndex, topic: str, role: Role, name: str) -> Stream:
    """Return the stream of a topic that the user named.

    Parameters
    ----------
    role : ``scan`` stands for point clouds as well.
    name : of the recording, for messages.

    Raises
    ------
    InputError
        There is no such topic of this role.
    """
    wanted = topic.strip("/")
    roles: tuple[Role, ...] = ("scan", "cloud") if role == "scan" else (role,)
    possible = [s for r in roles for s in index.with_role(r)]
    for stream in possible:
        if stream.topic.strip("/") == wanted:
            return stream
    there = ", ".join(stream.topic for stream in possible) or "no such topic"
    what = {"scan": "scans", "odometry": "odometry", "imu": "IMU readings"}[role]
    raise InputError(f"{name}: topic {topic} holds no {what}; there is {there}")
