# SPDX-License-Identifier: Apache-2.0
"""What is in a ROS recording and what was made of it, as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from cartoloop.readers.log import ProblemSeverity

Role = Literal["scan", "cloud", "odometry", "imu", "tf", "other"]


@dataclass(frozen=True, slots=True)
class BagFinding:
    """Something wrong or worth knowing, and what to do about it.

    Attributes
    ----------
    severity : ``error`` (part of the recording is lost), ``warning`` or ``note``.
    code : short name of the kind of finding, the same in all recordings.
    message : what is wrong, where; one line.
    remedy : what to do, or "".
    topic : which it is about, or "".
    count : how many times.
    stamp : of the first time, as recorded [s]; None where it is not about one moment.
    """

    severity: ProblemSeverity
    code: str
    message: str
    remedy: str = ""
    topic: str = ""
    count: int = 1
    stamp: float | None = None

    @property
    def line(self) -> str:
        """Message and remedy."""
        return f"{self.message}; {self.remedy}" if self.remedy else self.message


@dataclass(frozen=True, slots=True)
class StampStatistics:
    """The stamps of a topic's messages, as recorded.

    Attributes
    ----------
    first, last : stamps [s].
    rate : from the median time between stamps [Hz]; 0 with fewer than two.
    gaps : stamp before, and length, of each pause longer than `gap_limit` [s], longest first.
    gap_limit : three periods, at least 0.1 s (scans, odometry) or 0.05 s (IMU).
    num_zero : without a stamp.
    num_backwards, num_repeated : earlier than the one before, or equal to it.
    delay : median time from the stamp to the recording [s].
    largest_delay : the largest difference between stamp and recording [s], by amount.
    """

    first: float
    last: float
    rate: float
    gaps: tuple[tuple[float, float], ...]
    gap_limit: float
    num_zero: int
    num_backwards: int
    num_repeated: int
    delay: float
    largest_delay: float


@dataclass(frozen=True, slots=True)
class TopicSummary:
    """A topic of the recording.

    Attributes
    ----------
    topic, msgtype : names.
    role : what it could be good for.
    count : messages.
    frames : names of the frames its messages are in, the most frequent first.
    child_frames : those that odometry is of.
    num_undecodable : messages that are not what their type says.
    stamps : of its messages; None for topics that are not looked at.
    chosen : whether it is used for mapping.
    reason : why, or why not.
    """

    topic: str
    msgtype: str
    role: Role
    count: int
    frames: tuple[str, ...] = ()
    child_frames: tuple[str, ...] = ()
    num_undecodable: int = 0
    stamps: StampStatistics | None = None
    chosen: bool = False
    reason: str = ""


@dataclass(frozen=True, slots=True)
class TransformSummary:
    """What the recording says of the pose of one frame in another.

    Attributes
    ----------
    parent, child : frames.
    origin : ``tf_static``, ``tf``, ``urdf`` (the file given) or ``robot_description``.
    x, y, z : translation [m]; roll, pitch, yaw : Rz(yaw) Ry(pitch) Rx(roll) [rad]; first seen.
    count : how often it was sent.
    moved_m, moved_rad : how far from there it was ever seen.
    """

    parent: str
    child: str
    origin: str
    x: float
    y: float
    z: float
    roll: float
    pitch: float
    yaw: float
    count: int
    moved_m: float
    moved_rad: float


@dataclass(frozen=True, slots=True)
class Inventory:
    """A recording, opened and looked through once.

    Attributes
    ----------
    kind : what it is in, for the user.
    topics : all of them, by name.
    transforms : by child.
    base_frame : the frame whose way is sought, the tracking frame.
    findings : worst first.
    """

    kind: str
    topics: tuple[TopicSummary, ...]
    transforms: tuple[TransformSummary, ...]
    base_frame: str
    findings: tuple[BagFinding, ...]

    @property
    def chosen(self) -> tuple[TopicSummary, ...]:
        """The topics that are used."""
        return tuple(topic for topic in self.topics if topic.chosen)
