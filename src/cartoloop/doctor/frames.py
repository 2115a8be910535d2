# SPDX-License-Identifier: Apache-2.0
"""Checks of frames and transforms of a ROS recording. One function per check."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from cartoloop.doctor.findings import Finding
from cartoloop.readers.ros.inventory import TopicSummary, TransformSummary

_MAP_FRAMES = ("map", "world", "slam_map", "earth")
_SENSORS = ("scan", "cloud", "imu")


def check_frames(
    topics: Sequence[TopicSummary], transforms: Sequence[TransformSummary]
) -> list[Finding]:
    """Return the problems of frames and transforms."""
    return [
        *check_shared_frames(topics),
        *check_nameless_frames(topics),
        *check_other_slam(transforms),
    ]


def check_shared_frames(topics: Sequence[TopicSummary]) -> list[Finding]:
    """Several topics of one kind in one frame: one sensor, or two."""
    senders: dict[tuple[str, str], list[str]] = defaultdict(list)
    for topic in topics:
        if topic.role in _SENSORS and topic.frames and topic.frames[0]:
            senders[topic.role, topic.frames[0]].append(topic.topic)
    return [
        Finding(
            "info" if role == "scan" else "warning",
            "shared_frame",
            f"{', '.join(names)} have the same frame, {frame}",
            "give each sensor its own frame, or record only one of them",
            names[0],
            len(names),
        )
        for (role, frame), names in senders.items()
        if len(names) > 1
    ]


def check_nameless_frames(topics: Sequence[TopicSummary]) -> list[Finding]:
    """Messages without the name of a frame."""
    return [
        Finding(
            "warning",
            "nameless_frame",
            "the messages name no frame",
            "set the driver's frame_id, or give --laser-pose X,Y,YAW",
            topic.topic,
            topic.count,
        )
        for topic in topics
        if topic.role in _SENSORS and topic.count and topic.frames and not topic.frames[0]
    ]


def check_other_slam(transforms: Sequence[TransformSummary]) -> list[Finding]:
    """Moving transforms below a map frame: another SLAM or localisation was running."""
    return [
        Finding(
            "info",
            "other_slam",
            f"{t.parent} -> {t.child} on /tf is probably of another SLAM or localisation",
            "it is not used for mapping",
            "/tf",
            t.count,
        )
        for t in transforms
        if t.origin == "tf" and t.parent.lower().rsplit("/", 1)[-1] in _MAP_FRAMES
    ]
