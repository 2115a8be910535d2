# SPDX-License-Identifier: Apache-2.0
"""Which odometry of a recording is used, and why."""

from __future__ import annotations

from dataclasses import dataclass, field

from cartoloop.readers.read_options import NO_TOPIC, ReadOptions
from cartoloop.readers.ros.container import BagFinding
from cartoloop.readers.ros.index import RecordingIndex, TopicStream
from cartoloop.readers.ros.raw_messages import RawOdometry
from cartoloop.readers.ros.transforms import Pose3

# Parts of names with their penalties; topics with low penalties are preferred.
_ODOMETRY_PENALTIES = {
    "truth": 9, "gt": 9, "map": 6, "slam": 6, "amcl": 6, "gps": 5, "icp": 4, "vio": 4,
    "visual": 4, "lidar": 4, "laser": 4, "filtered": 2, "ekf": 2, "fused": 2, "wheel": -1,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class OdometryChoice:
    """The odometry in use, and the pose of the base in the frame whose pose it estimates."""

    stream: TopicStream
    tf_child_base: Pose3


@dataclass(eq=False)
class OdometrySelection:
    """Result of the choice: the odometry or None, why each topic is used or not, and doubts."""

    odometry: OdometryChoice | None = None
    reasons: dict[str, str] = field(default_factory=dict)
    findings: list[BagFinding] = field(default_factory=list)


def odometry_streams(index: RecordingIndex) -> list[TopicStream]:
    """Return the streams of odometry, the most likely wheel odometry first."""
    return sorted(index.with_role("odometry"), key=lambda s: s.rank(_ODOMETRY_PENALTIES))


def choose_odometry(
    index: RecordingIndex, options: ReadOptions, base: str, name: str
) -> OdometrySelection:
    """Choose the odometry: a topic, else a moving transform.

    Parameters
    ----------
    base : the tracking frame.
    name : of the recording, for messages.

    Raises
    ------
    InputError
        The topic asked for holds none.
    """
    choice = OdometrySelection()
    streams = odometry_streams(index)
    if options.odom_topic == NO_TOPIC:
        choice.reasons.update({s.topic: "no odometry is asked for" for s in streams})
        return choice
    moving = [stream for stream in streams if not _stands_still(stream)]
    if options.odom_topic is not None:
        chosen: TopicStream | None = index.named(options.odom_topic, "odometry", name)
        why = "asked for"
    elif moving:
        chosen = moving[0]
        why = "the only odometry" if len(streams) == 1 else "the most likely wheel odometry"
    else:
        chosen = _edge_of(index, base)
        edge = " -> ".join(chosen.edge or ()) if chosen is not None else ""
        why = f"{edge} serves as odometry: no topic holds any"
    for stream in streams:
        other = f"{chosen.topic} is used; --odom-topic for this one" if chosen else ""
        choice.reasons[stream.topic] = other if stream in moving else "its pose never changes"
    if chosen is None:
        return choice
    choice.reasons[chosen.topic] = why
    child = chosen.child_frame or base
    found = index.tree.lookup(child, base)
    if found is None:
        choice.findings.append(
            BagFinding(
                "warning",
                "missing_transform",
                f"no transform from {child} to {base}: the poses of {chosen.topic} "
                f"are taken for those of {base}",
                "record /tf_static, or give --urdf FILE",
                chosen.topic,
            )
        )
    choice.odometry = OdometryChoice(chosen, found[0] if found else Pose3.identity())
    return choice


def _stands_still(stream: TopicStream) -> bool:
    poses = {s.values for s in stream.samples if isinstance(s, RawOdometry)}
    return len(stream.samples) > 3 and len(poses) == 1


def _edge_of(index: RecordingIndex, base: str) -> TopicStream | None:
    """Return the poses on ``/tf`` of the base below an odometry frame, if they move."""
    above = index.tree.above(base)
    for edge in index.edges:
        parent, child = edge.edge or ("", "")
        transform = index.tree.transforms.get(child)
        moves = transform is not None and transform.parent == parent and transform.moves
        if moves and (child in above or len(index.edges) == 1):
            return edge
    return None
