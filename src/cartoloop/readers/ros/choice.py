# SPDX-License-Identifier: Apache-2.0
"""Which scanners, odometry and IMU of a recording are used, where they are mounted, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from cartoloop.errors import InputError
from cartoloop.readers.read_options import ReadOptions
from cartoloop.readers.ros.container import BagFinding
from cartoloop.readers.ros.imu_choice import ImuChoice, choose_imu
from cartoloop.readers.ros.index import RecordingIndex, TopicStream
from cartoloop.readers.ros.odometry_choice import (
    OdometryChoice,
    choose_odometry,
    odometry_streams,
)
from cartoloop.readers.ros.transforms import FrameTransform, Pose3

MAX_TILT = math.radians(15.0)
"""Scanners tilted by more than this see floor or ceiling in place of walls [rad]: at 15 degrees
and 0.3 m above the floor, from 1.2 m on."""

BASE_FRAMES = ("base_footprint", "base_link", "base", "base_frame", "robot_base", "chassis")
"""Usual names of the tracking frame, the most common first."""

_WORLD_FRAMES = frozenset(("map", "odom", "world", "earth", "odom_combined"))

_SAME_SWEEPS = 0.5
"""Share of equal stamps from which on two topics are taken for one scanner: copies that drop some
messages reach it, two scanners never have more than chance coincidences."""

# Parts of names with their penalties; topics with low penalties are preferred.
_SCAN_PENALTIES = {
    "vertical": 8, "down": 6, "cliff": 6, "back": 3, "rear": 3, "merged": 2, "throttle": 2,
    "filtered": 2, "camera": 2, "depth": 2, "right": 1, "left": 1, "horizontal": -1, "front": -1,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class ScannerChoice:
    """A scanner in use, and its pose in the base frame."""

    stream: TopicStream
    tf_base_sensor: Pose3


@dataclass(eq=False)
class TopicChoice:
    """The topics of a recording that are used.

    Attributes
    ----------
    base_frame : the tracking frame.
    scanners : at least one, the main one first; all scanners or all clouds.
    odometry, imu : or None.
    reasons : why each topic is used or not.
    findings : missing transforms and other doubts.
    """

    base_frame: str = ""
    scanners: list[ScannerChoice] = field(default_factory=list)
    odometry: OdometryChoice | None = None
    imu: ImuChoice | None = None
    reasons: dict[str, str] = field(default_factory=dict)
    findings: list[BagFinding] = field(default_factory=list)

    @property
    def streams(self) -> list[TopicStream]:
        """All streams in use, the main scanner first."""
        used = [scanner.stream for scanner in self.scanners]
        used += [self.odometry.stream] if self.odometry else []
        used += [self.imu.stream] if self.imu else []
        return used


def choose_topics(index: RecordingIndex, options: ReadOptions, name: str) -> TopicChoice:
    """Choose the topics to map with.

    Parameters
    ----------
    name : of the recording, for messages.

    Raises
    ------
    InputError
        A topic is asked for that the recording does not hold, or it holds no scans.
    """
    choice = TopicChoice()
    candidates = _scan_candidates(index, options, choice, name)
    _choose_base(index, candidates, options, choice)
    _choose_scanners(index, candidates, options, choice)
    odometry = choose_odometry(index, options, choice.base_frame, name)
    imu = choose_imu(index, options, choice.base_frame, name)
    choice.odometry, choice.imu = odometry.odometry, imu.imu
    choice.reasons.update(odometry.reasons | imu.reasons)
    choice.findings += odometry.findings + imu.findings
    return choice


def _scan_candidates(
    index: RecordingIndex, options: ReadOptions, choice: TopicChoice, name: str
) -> list[TopicStream]:
    """Return the streams that may be mapped, best first."""
    if options.scan_topics:
        asked = [index.named(topic, "scan", name) for topic in options.scan_topics]
        if len({stream.role for stream in asked}) > 1:
            raise InputError(
                f"{name}: --scan-topic names scans and point clouds; name one kind of them"
            )
        for stream in index.with_role("scan") + index.with_role("cloud"):
            choice.reasons[stream.topic] = "asked for" if stream in asked else "not asked for"
        return list(dict.fromkeys(asked))
    scans = sorted(index.with_role("scan"), key=lambda s: s.rank(_SCAN_PENALTIES))
    clouds = sorted(index.with_role("cloud"), key=lambda s: s.rank(_SCAN_PENALTIES))
    if scans:
        for stream in clouds:
            choice.reasons[stream.topic] = "the laser scans are used"
        return _without_copies(scans, choice)
    for stream in clouds[1:]:
        choice.reasons[stream.topic] = f"{clouds[0].topic} is used; --scan-topic for this one"
    if not clouds:
        raise InputError(_no_scans_message(index, name))
    return clouds[:1]


def _without_copies(scans: list[TopicStream], choice: TopicChoice) -> list[TopicStream]:
    """Return the streams without those that send another's sweeps once more (filtered ones)."""
    kept: list[TopicStream] = []
    for stream in scans:
        original = next((k for k in kept if _same_scanner(k, stream)), None)
        if original is None:
            kept.append(stream)
        else:
            choice.reasons[stream.topic] = f"the same sweeps as {original.topic}"
    return kept


def _same_scanner(a: TopicStream, b: TopicStream) -> bool:
    if a.frame != b.frame:
        return False
    shared = np.intersect1d(np.array(a.stamps), np.array(b.stamps))
    shared = shared[shared > 0]
    return len(shared) > _SAME_SWEEPS * min(len(a.stamps), len(b.stamps))


def _no_scans_message(index: RecordingIndex, name: str) -> str:
    topics = sorted({s.topic for s in index.streams if s.stamps} | {c.topic for c in index.others})
    damage = f" ({index.container.damage})" if index.container.damage else ""
    if not topics:
        return f"{name}: holds no messages{damage}; record again"
    listed = ", ".join(topics[:6]) + (", ..." if len(topics) > 6 else "")
    return (
        f"{name}: holds no laser scans and no point clouds{damage}, only {listed}; "
        "record a topic of type LaserScan, MultiEchoLaserScan or PointCloud2"
    )


def _choose_base(
    index: RecordingIndex, candidates: list[TopicStream], options: ReadOptions, choice: TopicChoice
) -> None:
    """Set the tracking frame: one of the usual names, or a frame above the scanner's."""
    tree, main = index.tree, candidates[0]
    odometry = odometry_streams(index)
    children = [s.child_frame for s in [*odometry, *index.edges] if s.child_frame]
    roots = [frame for frame in reversed(tree.above(main.frame)) if frame not in _WORLD_FRAMES]
    known = tree.frames | set(children)
    named = [frame for frame in BASE_FRAMES if frame in known]
    if options.laser_pose is not None:
        choice.base_frame = next(iter([*named, *children]), "base_link")
        return
    reached = [sum(tree.lookup(frame, s.frame) is not None for s in candidates) for frame in named]
    if any(reached):
        choice.base_frame = named[reached.index(max(reached))]
        return
    for frame in [*children, main.frame]:
        if tree.lookup(frame, main.frame) is not None and frame != main.frame:
            choice.base_frame = frame
            return
    if roots and roots[0] != main.frame:
        choice.base_frame = roots[0]
        return
    choice.base_frame = main.frame
    wanted = next(iter([*named, *children]), "base_link")
    if main.frame != wanted:
        choice.findings.append(_missing(wanted, main, "it is mapped in the scanner's own frame"))


def _missing(base: str, stream: TopicStream, consequence: str) -> BagFinding:
    return BagFinding(
        "warning",
        "missing_transform",
        f"no transform from {base} to {stream.frame or 'the scanner, whose frame has no name'} "
        f"({stream.topic}): {consequence}",
        "record /tf_static, or give --urdf FILE or --laser-pose X,Y,YAW",
        stream.topic,
    )


def _choose_scanners(
    index: RecordingIndex, candidates: list[TopicStream], options: ReadOptions, choice: TopicChoice
) -> None:
    asked = bool(options.scan_topics)
    tilted: list[tuple[TopicStream, float]] = []
    for number, stream in enumerate(candidates):
        if number == 0 and options.laser_pose is not None:
            _use(choice, stream, Pose3.from_plane(options.laser_pose), "pose as given")
            continue
        found = index.tree.lookup(choice.base_frame, stream.frame)
        if found is None:
            _leave_out(choice, stream)
            continue
        pose, transforms = found
        tilt = math.acos(min(1.0, abs(float(pose.rotation[2, 2]))))
        if stream.role == "scan" and tilt > MAX_TILT and not asked:
            tilted.append((stream, tilt))
            continue
        choice.findings += _moving(transforms, stream)
        _use(choice, stream, pose, _where(choice, stream, pose))
    for stream, tilt in tilted:
        tilted_by = f"its plane is tilted by {math.degrees(tilt):.0f} deg"
        if choice.scanners:
            choice.reasons[stream.topic] = f"{tilted_by}; --scan-topic to use it nevertheless"
            continue
        choice.base_frame = stream.frame
        choice.findings.append(
            BagFinding(
                "warning",
                "tilted_scanner",
                f"{stream.topic}: {tilted_by} by its transform; it is mapped in its own frame, "
                "as if it were level",
                "correct the transform, or give --laser-pose X,Y,YAW",
                stream.topic,
            )
        )
        _use(choice, stream, Pose3.identity(), f"the only scanner, though {tilted_by}")


def _use(choice: TopicChoice, stream: TopicStream, pose: Pose3, why: str) -> None:
    choice.scanners.append(ScannerChoice(stream, pose))
    before = choice.reasons.get(stream.topic)
    choice.reasons[stream.topic] = f"{before}, {why}" if before else why


def _leave_out(choice: TopicChoice, stream: TopicStream) -> None:
    choice.findings.append(_missing(choice.base_frame, stream, "it is left out"))
    choice.reasons[stream.topic] = f"no transform from {choice.base_frame} to {stream.frame}"


def _where(choice: TopicChoice, stream: TopicStream, pose: Pose3) -> str:
    if stream.frame == choice.base_frame:
        return "in its own frame"
    # Adding 0 turns -0.0, the rounded value of small negative numbers, into 0.0.
    x, y, z = (round(float(value), 2) + 0.0 for value in pose.translation)
    roll, pitch, yaw = (round(math.degrees(angle), 1) + 0.0 for angle in pose.rpy)
    upside_down = ", upside down" if pose.rotation[2, 2] < 0.0 else ""
    return (
        f"at x {x:.2f}, y {y:.2f}, z {z:.2f} m, roll {roll:.1f}, pitch {pitch:.1f}, "
        f"yaw {yaw:.1f} deg in {choice.base_frame}{upside_down}"
    )


def _moving(transforms: list[FrameTransform], stream: TopicStream) -> list[BagFinding]:
    return [
        BagFinding(
            "warning",
            "moving_mounting",
            f"the transform from {t.parent} to {t.child} moves (by up to {t.moved_m:.3f} m, "
            f"{math.degrees(t.moved_rad):.1f} deg), and {stream.topic} is mounted below it; "
            "its first pose is used for the whole recording",
            "fix the scanner, or give its mounting pose with --laser-pose X,Y,YAW",
            stream.topic,
        )
        for t in transforms
        if t.moves
    ]
