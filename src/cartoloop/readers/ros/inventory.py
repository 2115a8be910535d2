# SPDX-License-Identifier: Apache-2.0
"""Contents of a ROS recording and what is used of it, as data and as text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cartoloop.readers.ros.choice import TopicChoice
from cartoloop.readers.ros.container import BagFinding, Container
from cartoloop.readers.ros.index import RecordingIndex, Role, TopicStream
from cartoloop.readers.ros.stream_times import StampStatistics, stamp_statistics
from cartoloop.sensor.sensor_profile import SensorProfile

_MAX_OTHERS = 8
"""Topics without a use that are listed by name."""


@dataclass(frozen=True, slots=True)
class TopicSummary:
    """A topic of the recording.

    Attributes
    ----------
    topic, msgtype : names.
    role : kind of data in its messages.
    count : messages.
    frames : names of the frames of its messages, the most frequent first.
    child_frames : frames whose pose odometry estimates.
    num_undecodable : messages that do not match their type.
    stamps : of its messages; None for topics that are not indexed.
    chosen : whether it is used for mapping.
    reason : why it is used or not.
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
    """The pose of one frame in another, as recorded.

    Attributes
    ----------
    parent, child : frames.
    origin : ``tf_static``, ``tf``, ``urdf`` (the file given) or ``robot_description``.
    x, y, z : translation [m]; roll, pitch, yaw : Rz(yaw) Ry(pitch) Rx(roll) [rad]; first seen.
    count : number of messages with it.
    moved_m, moved_rad : largest distance from the first pose.
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
    """The contents of a recording after the first pass.

    Attributes
    ----------
    kind : of recording, for the user.
    topics : all of them, by name.
    transforms : by child.
    base_frame : the tracking frame, whose trajectory is estimated.
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


def container_findings(container: Container) -> list[BagFinding]:
    """Return the problems of the files of a recording."""
    found = list(container.notes)
    if container.damage:
        found.append(
            BagFinding(
                "error",
                "damaged",
                f"{container.damage}; the part before is used",
                "copy or record it again for the rest",
            )
        )
    return found


def stream_findings(index: RecordingIndex) -> list[BagFinding]:
    """Return the problems of single topics: several frames, transforms that cannot be decoded."""
    found = []
    for stream in index.streams:
        frames = stream.frame_names
        if stream.edge is None and len(frames) > 1:
            what = f"{stream.topic}: its messages are in several frames ({', '.join(frames[:4])})"
            remedy = "all are taken for the first; let each sensor have a topic of its own"
            found.append(BagFinding("warning", "several_frames", what, remedy, stream.topic))
        if stream.role == "tf" and stream.undecodable:
            count = sum(stream.undecodable.values())
            why = ", ".join(sorted(stream.undecodable))
            what = f"{stream.topic}: {count} transforms or messages cannot be used ({why})"
            found.append(
                BagFinding("warning", "undecodable", what, "left out", stream.topic, count)
            )
    return found


def take_inventory(
    index: RecordingIndex, choice: TopicChoice, findings: Sequence[BagFinding]
) -> Inventory:
    """Return the contents of a recording."""
    used = choice.streams
    topics = [
        _summary(stream, choice, chosen=stream in used)
        for stream in index.streams
        if stream.edge is None
    ]
    for stream in used:
        if stream.edge is not None:
            topics = [
                _summary(stream, choice, chosen=True) if t.topic == stream.topic else t
                for t in topics
            ]
    topics += [TopicSummary(c.topic, c.msgtype, "other", c.num_messages) for c in index.others]
    transforms = []
    for child, transform in sorted(index.tree.transforms.items()):
        x, y, z = (float(v) for v in transform.pose.translation)
        transforms.append(
            TransformSummary(
                transform.parent, child, transform.origin, x, y, z, *transform.pose.rpy,
                transform.count, transform.moved_m, transform.moved_rad,
            )
        )  # fmt: skip
    return Inventory(
        kind=index.container.kind,
        topics=tuple(sorted(topics, key=lambda topic: topic.topic)),
        transforms=tuple(transforms),
        base_frame=choice.base_frame,
        findings=tuple(findings),
    )


def _summary(stream: TopicStream, choice: TopicChoice, *, chosen: bool) -> TopicSummary:
    reason = choice.reasons.get(stream.topic, "")
    if stream.role == "tf" and not reason:
        reason = "transforms"
    if not stream.stamps:
        reason = "no message"
    return TopicSummary(
        topic=stream.topic,
        msgtype=stream.msgtype,
        role=stream.role,
        count=len(stream.stamps),
        frames=stream.frame_names,
        child_frames=tuple(frame for frame, _ in stream.child_frames.most_common()),
        num_undecodable=sum(stream.undecodable.values()),
        stamps=stamp_statistics(stream),
        chosen=chosen,
        reason=reason,
    )


def describe(inventory: Inventory, profile: SensorProfile) -> str:
    """Return the topics of a recording, and which of them are used and why."""
    lines = []
    for topic in inventory.topics:
        if topic.role not in ("scan", "cloud", "odometry", "imu") or not topic.count:
            continue
        rate = f", {topic.stamps.rate:.3g} Hz" if topic.stamps is not None else ""
        verb = "used" if topic.chosen else "not used"
        kind = topic.msgtype.rsplit("/", 1)[-1]
        because = f" ({topic.reason})" if topic.reason else ""
        lines.append(f"{topic.topic}  {kind}, {topic.count} messages{rate}: {verb}{because}")
    others = [t.topic for t in inventory.topics if t.role == "other"]
    if others:
        more = ", ..." if len(others) > _MAX_OTHERS else ""
        lines.append(f"other topics  {', '.join(others[:_MAX_OTHERS])}{more}: not used")
    lines.append(f"tracking frame  {inventory.base_frame}")
    return "\n".join((*lines, profile.describe()))
