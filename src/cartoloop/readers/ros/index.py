# SPDX-License-Identifier: Apache-2.0
"""The first pass over a recording: stamps, frames, transforms and a sample of each sensor."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from cartoloop.errors import InputError
from cartoloop.readers.copies import CopyFinder
from cartoloop.readers.read_options import ReadOptions
from cartoloop.readers.ros import raw_messages as ros
from cartoloop.readers.ros.cloud import RawCloud, decode_cloud
from cartoloop.readers.ros.container import BagFinding, Channel, Container
from cartoloop.readers.ros.transforms import TransformTree
from cartoloop.readers.ros.urdf import parse_urdf, read_urdf
from cartoloop.readers.ros.wire import DecodeError, frame_name, read_header

Role = Literal["scan", "cloud", "odometry", "imu", "tf", "other"]

ROLES: dict[str, Role] = {
    ros.LASER_SCAN: "scan",
    ros.MULTI_ECHO: "scan",
    ros.POINT_CLOUD: "cloud",
    ros.IMU: "imu",
    ros.ODOMETRY: "odometry",
    **dict.fromkeys(ros.TF_TYPES, "tf"),
}

NO_STAMP = -1
"""In place of the stamp of a message that cannot be decoded [ns]."""

_LATEST = 2**63 - 1  # largest number that the arrays of stamps hold [ns]
_SAMPLES: dict[Role, int] = {"scan": 300, "cloud": 6, "imu": 600, "odometry": 300}

Sample = ros.RawScan | ros.RawImu | ros.RawOdometry | RawCloud


@dataclass(eq=False)
class TopicStream:
    """The messages of one topic, or the poses of one frame in another on ``/tf``.

    Attributes
    ----------
    topic, msgtype, role, is_ros1 : name, type, kind of data and encoding of its messages.
    keys : of the container's channels it comes from.
    edge : parent and child frame, of poses on ``/tf``; else None.
    stamps, records : stamp and time of recording of each message [ns]; `NO_STAMP` if it has no
        valid header.
    frames, child_frames : number of messages by frame.
    undecodable : number of messages of the sample that cannot be decoded, by reason.
    samples : some messages, in groups of three successive ones.
    """

    topic: str
    msgtype: str
    role: Role
    is_ros1: bool
    expected: int = 0
    keys: list[int] = field(default_factory=list)
    edge: tuple[str, str] | None = None
    stamps: array[int] = field(default_factory=lambda: array("q"))
    records: array[int] = field(default_factory=lambda: array("q"))
    frames: Counter[bytes] = field(default_factory=Counter)
    child_frames: Counter[str] = field(default_factory=Counter)
    undecodable: Counter[str] = field(default_factory=Counter)
    samples: list[Sample] = field(default_factory=list)

    @property
    def frame(self) -> str:
        """The most frequent frame, or ""."""
        return self.frame_names[0] if self.frames else ""

    @property
    def frame_names(self) -> tuple[str, ...]:
        """All frames, the most frequent first."""
        if self.edge is not None:
            return self.edge[:1]
        return tuple(frame_name(frame) for frame, _ in self.frames.most_common())

    @property
    def child_frame(self) -> str:
        """The frame whose pose odometry estimates, or ""."""
        return self.child_frames.most_common(1)[0][0] if self.child_frames else ""

    @property
    def num_readable(self) -> int:
        """Number of messages with a header."""
        return len(self.stamps) - self.stamps.count(NO_STAMP)

    def rank(self, penalties: Mapping[str, int]) -> tuple[int, int, str]:
        """Return a sort key: low penalties of the parts of its names, then many messages."""
        names = f"{self.topic} {self.frame}".lower()
        penalty = sum(value for part, value in penalties.items() if part in names)
        return (penalty, -len(self.stamps), self.topic)


@dataclass(eq=False)
class RecordingIndex:
    """Result of the first pass over a recording.

    Attributes
    ----------
    container : the recording.
    streams : one for each topic of a usable type, and for each frame below an odometry frame.
    others : the channels of other types.
    tree : all transforms.
    findings : problems of transforms and robot descriptions.
    """

    container: Container
    streams: list[TopicStream]
    others: list[Channel]
    tree: TransformTree
    findings: list[BagFinding]

    @property
    def num_messages(self) -> int:
        """Number of indexed messages."""
        return sum(len(stream.stamps) for stream in self.streams)

    def with_role(self, role: Role) -> list[TopicStream]:
        """Return the streams of a role with readable messages, without those on ``/tf``."""
        return [s for s in self.streams if s.role == role and s.edge is None and s.num_readable > 0]

    def named(self, topic: str, role: Role, name: str) -> TopicStream:
        """Return the stream of a topic that the user named.

        Parameters
        ----------
        role : ``scan`` includes point clouds.
        name : of the recording, for messages.

        Raises
        ------
        InputError
            There is no such topic of this role.
        """
        roles: tuple[Role, ...] = ("scan", "cloud") if role == "scan" else (role,)
        possible = [stream for r in roles for stream in self.with_role(r)]
        for stream in possible:
            if stream.topic.strip("/") == topic.strip("/"):
                return stream
        known = ", ".join(stream.topic for stream in possible) or "no such topic"
        what = {"scan": "scans", "odometry": "odometry", "imu": "IMU readings"}[role]
        raise InputError(f"{name}: topic {topic} holds no {what}; there is {known}")

    @property
    def edges(self) -> list[TopicStream]:
        """The poses on ``/tf`` that may serve as odometry."""
        return [stream for stream in self.streams if stream.edge is not None]


def index_recording(container: Container, options: ReadOptions) -> RecordingIndex:
    """Read a recording once.

    Raises
    ------
    InputError
        The file given is not a URDF file.
    """
    tree = TransformTree()
    findings: list[BagFinding] = []
    if options.urdf is not None:
        for joint in read_urdf(options.urdf):
            tree.add(joint.parent, joint.child, joint.pose, "urdf")
    streams: dict[tuple[str, str], TopicStream] = {}
    by_key: dict[int, TopicStream] = {}
    others = []
    described: set[int] = set()
    for channel in container.channels:
        role = ROLES.get(channel.msgtype)
        if role is None:
            others.append(channel)
            if channel.msgtype == ros.STRING and channel.topic.endswith("robot_description"):
                described.add(channel.key)
            continue
        stream = streams.setdefault(
            (channel.topic, channel.msgtype),
            TopicStream(channel.topic, channel.msgtype, role, channel.is_ros1),
        )
        stream.keys.append(channel.key)
        stream.expected += channel.num_messages
        by_key[channel.key] = stream
    is_ros1 = {channel.key: channel.is_ros1 for channel in container.channels}
    edges: dict[tuple[str, str], TopicStream] = {}
    copies = {name: CopyFinder() for name in streams}
    for key, recorded, raw in container.messages(by_key.keys() | described):
        record = min(recorded, _LATEST)
        if key in described:
            findings += _describe(tree, raw, is_ros1[key])
            continue
        stream = by_key[key]
        if stream.role == "tf":
            _add_transforms(tree, stream, edges, record, raw)
        elif not is_copy(raw, stream, copies[stream.topic, stream.msgtype]):
            _add_message(stream, record, raw)
    findings += _conflicts(tree)
    return RecordingIndex(container, [*streams.values(), *edges.values()], others, tree, findings)


def is_copy(raw: bytes, stream: TopicStream, copies: CopyFinder) -> bool:
    """Return whether a message of a stream is held twice."""
    try:
        return copies.is_copy(raw) and read_header(raw, stream.is_ros1).stamp > 0
    except DecodeError:
        return False


def _add_message(stream: TopicStream, record: int, raw: bytes) -> None:
    number = len(stream.stamps)
    stream.records.append(record)
    try:
        header = read_header(raw, stream.is_ros1)
    except DecodeError as error:
        stream.stamps.append(NO_STAMP)
        stream.undecodable[str(error)] += 1
        return
    stream.stamps.append(max(header.stamp, 0))
    stream.frames[header.frame] += 1
    if _is_sampled(stream, number):
        try:
            stream.samples.append(_decode(stream, raw))
        except DecodeError as error:
            stream.undecodable[str(error)] += 1


def _is_sampled(stream: TopicStream, number: int) -> bool:
    groups = _SAMPLES[stream.role] // 3
    every = max(stream.expected // groups, 3)
    return number % every < 3 and len(stream.samples) < 2 * _SAMPLES[stream.role]


def _decode(stream: TopicStream, raw: bytes) -> Sample:
    if stream.msgtype == ros.LASER_SCAN:
        return ros.decode_scan(raw, stream.is_ros1)
    if stream.msgtype == ros.MULTI_ECHO:
        return ros.decode_multi_echo(raw, stream.is_ros1)
    if stream.role == "imu":
        return ros.decode_imu(raw, stream.is_ros1)
    if stream.role == "odometry":
        message = ros.decode_odometry(raw, stream.is_ros1)
        stream.child_frames[message.child] += 1
        return message
    return decode_cloud(raw, stream.is_ros1)


def _add_transforms(
    tree: TransformTree,
    stream: TopicStream,
    edges: dict[tuple[str, str], TopicStream],
    record: int,
    raw: bytes,
) -> None:
    stream.stamps.append(record)
    stream.records.append(record)
    static = stream.topic.rstrip("/").endswith("tf_static")
    try:
        sent = ros.decode_transforms(raw, stream.is_ros1)
    except DecodeError as error:
        stream.undecodable[str(error)] += 1
        return
    for transform in sent:
        try:
            tree.add_sent(
                transform.parent, transform.child, transform.values, "tf_static" if static else "tf"
            )
        except ValueError:
            stream.undecodable["transform that is not a pose"] += 1
    if static:
        return
    # In the order as sent: the order of a set differs between processes.
    for parent, child in dict.fromkeys(
        (t.parent, t.child) for t in sent if "odom" in t.parent.lower()
    ):
        edge = edges.get((parent, child))
        if edge is None:
            edge = TopicStream(stream.topic, stream.msgtype, "odometry", stream.is_ros1)
            edge.edge = (parent, child)
            edge.child_frames[child] = 1
            edge.keys = stream.keys
            edges[parent, child] = edge
        last = edge.stamps[-1] if edge.stamps else NO_STAMP
        for transform in new_poses(sent, (parent, child), last):
            edge.stamps.append(transform.stamp)
            edge.records.append(record)


def new_poses(
    sent: list[ros.RawTransform], edge: tuple[str, str], last_stamp: int
) -> Iterator[ros.RawTransform]:
    """Yield the poses of an edge, each once: ``/tf`` repeats them with their old stamp."""
    for transform in sent:
        if (transform.parent, transform.child) == edge and transform.stamp != last_stamp:
            last_stamp = transform.stamp
            yield transform


def _describe(tree: TransformTree, raw: bytes, is_ros1: bool) -> list[BagFinding]:
    """Add the joints of a robot description in the recording."""
    try:
        joints = parse_urdf(ros.decode_string(raw, is_ros1), "robot_description")
    except (DecodeError, InputError) as error:
        return [BagFinding("warning", "robot_description", f"{error}", "give --urdf FILE")]
    for joint in joints:
        tree.add(joint.parent, joint.child, joint.pose, "robot_description")
    return []


def _conflicts(tree: TransformTree) -> list[BagFinding]:
    return [
        BagFinding(
            "warning",
            "several_parents",
            f"frame {child} has several parents: {tree.transforms[child].parent}, "
            f"{', '.join(sorted(parents))}",
            "the first is used; let only one node send this transform",
        )
        for child, parents in sorted(tree.conflicts.items())
    ]
