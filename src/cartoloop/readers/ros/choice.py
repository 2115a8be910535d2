# SPDX-License-Identifier: Apache-2.0
"""Which topics of a recording are used, where their sensors sit, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from cartoloop.errors import InputError
from cartoloop.readers.options import NO_TOPIC, ReadOptions
from cartoloop.readers.ros.index import RecordingIndex, Stream
from cartoloop.readers.ros.inventory import Finding
from cartoloop.readers.ros.messages import ImuMessage, OdometryMessage
from cartoloop.readers.ros.transforms import Pose3, Transform

MAX_TILT = math.radians(15.0)
"""Scanners that look farther up or down than this do not see the walls that a map is made of."""

BASE_FRAMES = ("base_footprint", "base_link", "base", "base_frame", "robot_base", "chassis")
_WORLD_FRAMES = frozenset(("map", "odom", "world", "earth", "odom_combined"))
_SAME_SWEEPS = 0.5  # share of equal stamps at which two topics are one scanner
_ABSURD = 1e6  # m/s^2
_GRAVITY_MISFIT = math.radians(45.0)

# Parts of names, and how welcome the topic is: the smaller the better.
_SCAN_NAMES = {
    "vertical": 8, "down": 6, "cliff": 6, "back": 3, "rear": 3, "merged": 2, "throttle": 2,
    "filtered": 2, "camera": 2, "depth": 2, "right": 1, "left": 1, "horizontal": -1, "front": -1,
}  # fmt: skip
_ODOMETRY_NAMES = {
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
    """The IMU that is used; its pose in the base frame, and by what its accelerations count."""

    stream: Stream
    tf_base_sensor: Pose3
    acceleration_scale: float


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
    findings: list[Finding] = field(default_factory=list)

    @property
    def streams(self) -> list[Stream]:
        """All that is used, the main scanner first."""
        used = [scanner.stream for scanner in self.scanners]
        used += [self.odometry.stream] if self.odometry else []
        used += [self.imu.stream] if self.imu else []
        return used


def choose_topics(index: RecordingIndex, options: ReadOptions, name: str) -> Choice:
    """Choose what to map with.

    Parameters
    ----------
    name : of the recording, for messages.

    Raises
    ------
    InputError
        A topic is asked for that the recording does not hold, or it holds no scans.
    """
    choice = Choice()
    candidates = _scan_candidates(index, options, choice, name)
    _choose_base(index, candidates, options, choice)
    _choose_scanners(index, candidates, options, choice)
    _choose_odometry(index, options, choice, name)
    _choose_imu(index, options, choice, name)
    return choice


def _rank(stream: Stream, names: dict[str, int]) -> tuple[int, int, str]:
    text = f"{stream.topic} {stream.frame}".lower()
    return (sum(n for part, n in names.items() if part in text), -len(stream.stamps), stream.topic)


def _asked_for(index: RecordingIndex, topic: str, role: str, name: str) -> Stream:
    """Return the stream of a topic that the user named."""
    wanted = topic.strip("/")
    roles = ("scan", "cloud") if role == "scan" else (role,)
    possible = [s for r in roles for s in index.with_role(r)]  # type: ignore[arg-type]
    for stream in possible:
        if stream.topic.strip("/") == wanted:
            return stream
    there = ", ".join(stream.topic for stream in possible) or "no such topic"
    what = {"scan": "scans", "odometry": "odometry", "imu": "IMU readings"}[role]
    raise InputError(f"{name}: topic {topic} holds no {what}; there is {there}")


def _scan_candidates(
    index: RecordingIndex, options: ReadOptions, choice: Choice, name: str
) -> list[Stream]:
    """Return the streams that may be mapped, best first."""
    if options.scan_topics:
        asked = [_asked_for(index, topic, "scan", name) for topic in options.scan_topics]
        if len({stream.role for stream in asked}) > 1:
            raise InputError(
                f"{name}: --scan-topic names scans and point clouds; name one kind of them"
            )
        for stream in index.with_role("scan") + index.with_role("cloud"):
            choice.reasons[stream.topic] = "asked for" if stream in asked else "not asked for"
        return list(dict.fromkeys(asked))
    scans = sorted(index.with_role("scan"), key=lambda s: _rank(s, _SCAN_NAMES))
    clouds = sorted(index.with_role("cloud"), key=lambda s: _rank(s, _SCAN_NAMES))
    if scans:
        for stream in clouds:
            choice.reasons[stream.topic] = "the laser scans are used"
        return _without_copies(scans, choice)
    for stream in clouds[1:]:
        choice.reasons[stream.topic] = f"{clouds[0].topic} is used; --scan-topic for this one"
    if not clouds:
        raise InputError(_why_no_scans(index, name))
    return clouds[:1]


def _without_copies(scans: list[Stream], choice: Choice) -> list[Stream]:
    """Return the streams without those that send another's sweeps once more (filtered ones)."""
    kept: list[Stream] = []
    for stream in scans:
        original = next((k for k in kept if _same_scanner(k, stream)), None)
        if original is None:
            kept.append(stream)
        else:
            choice.reasons[stream.topic] = f"the same sweeps as {original.topic}"
    return kept


def _same_scanner(a: Stream, b: Stream) -> bool:
    if a.frame != b.frame:
        return False
    shared = np.intersect1d(np.array(a.stamps), np.array(b.stamps))
    shared = shared[shared > 0]
    return len(shared) > _SAME_SWEEPS * min(len(a.stamps), len(b.stamps))


def _why_no_scans(index: RecordingIndex, name: str) -> str:
    there = sorted({s.topic for s in index.streams if s.stamps} | {c.topic for c in index.others})
    damage = f" ({index.container.damage})" if index.container.damage else ""
    if not there:
        return f"{name}: holds no messages{damage}; record again"
    listed = ", ".join(there[:6]) + (", ..." if len(there) > 6 else "")
    return (
        f"{name}: holds no laser scans and no point clouds{damage}, only {listed}; "
        "record a topic of type LaserScan, MultiEchoLaserScan or PointCloud2"
    )


def _choose_base(
    index: RecordingIndex, candidates: list[Stream], options: ReadOptions, choice: Choice
) -> None:
    """Set the frame whose way is sought: one of the usual names, or what holds the scanner."""
    tree, main = index.tree, candidates[0]
    odometry = sorted(index.with_role("odometry"), key=lambda s: _rank(s, _ODOMETRY_NAMES))
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


def _missing(base: str, stream: Stream, meanwhile: str) -> Finding:
    return Finding(
        "warning",
        "missing_transform",
        f"no transform from {base} to {stream.frame or 'the scanner, whose frame has no name'} "
        f"({stream.topic}): {meanwhile}",
        "record /tf_static, or give --urdf FILE or --laser-pose X,Y,YAW",
        stream.topic,
    )


def _choose_scanners(
    index: RecordingIndex, candidates: list[Stream], options: ReadOptions, choice: Choice
) -> None:
    asked = bool(options.scan_topics)
    tilted: list[tuple[Stream, float]] = []
    for number, stream in enumerate(candidates):
        if number == 0 and options.laser_pose is not None:
            _use(choice, stream, Pose3.from_plane(options.laser_pose), "pose as given")
            continue
        found = index.tree.lookup(choice.base_frame, stream.frame)
        if found is None:
            _leave_out(choice, stream)
            continue
        pose, way = found
        tilt = math.acos(min(1.0, abs(float(pose.rotation[2, 2]))))
        if stream.role == "scan" and tilt > MAX_TILT and not asked:
            tilted.append((stream, tilt))
            continue
        choice.findings += _moving(way, stream)
        _use(choice, stream, pose, _where(choice, stream, pose))
    if not asked:
        for scanner in choice.scanners[1:]:
            choice.reasons[scanner.stream.topic] = (
                f"{choice.scanners[0].stream.topic} is used; --scan-topic for this one"
            )
        del choice.scanners[1:]
    for stream, tilt in tilted:
        told = f"its plane is tilted by {math.degrees(tilt):.0f} deg"
        if choice.scanners:
            choice.reasons[stream.topic] = f"{told}; --scan-topic to use it all the same"
            continue
        choice.base_frame = stream.frame
        choice.findings.append(
            Finding(
                "warning",
                "tilted_scanner",
                f"{stream.topic}: {told}, says the transform; it is mapped in its own frame, "
                "as if it were level",
                "correct the transform, or give --laser-pose X,Y,YAW",
                stream.topic,
            )
        )
        _use(choice, stream, Pose3.identity(), f"the only scanner, though {told}")


def _use(choice: Choice, stream: Stream, pose: Pose3, why: str) -> None:
    choice.scanners.append(ScannerChoice(stream, pose))
    before = choice.reasons.get(stream.topic)
    choice.reasons[stream.topic] = f"{before}, {why}" if before else why


def _leave_out(choice: Choice, stream: Stream) -> None:
    choice.findings.append(_missing(choice.base_frame, stream, "it is left out"))
    choice.reasons[stream.topic] = f"no transform from {choice.base_frame} to {stream.frame}"


def _where(choice: Choice, stream: Stream, pose: Pose3) -> str:
    if stream.frame == choice.base_frame:
        return "in its own frame"
    # Adding 0 turns -0.0, as which small negative numbers are shown, into 0.0.
    x, y, z = (round(float(value), 2) + 0.0 for value in pose.translation)
    roll, pitch, yaw = (round(math.degrees(angle), 1) + 0.0 for angle in pose.rpy)
    upside_down = ", upside down" if pose.rotation[2, 2] < 0.0 else ""
    return (
        f"at x {x:.2f}, y {y:.2f}, z {z:.2f} m, roll {roll:.1f}, pitch {pitch:.1f}, "
        f"yaw {yaw:.1f} deg in {choice.base_frame}{upside_down}"
    )


def _moving(way: list[Transform], stream: Stream) -> list[Finding]:
    return [
        Finding(
            "warning",
            "moving_mounting",
            f"the transform from {t.parent} to {t.child} moves (by up to {t.moved_m:.3f} m, "
            f"{math.degrees(t.moved_rad):.1f} deg), and {stream.topic} hangs on it; "
            "the first one is taken for all the time",
            "fix the scanner, or give its place with --laser-pose X,Y,YAW",
            stream.topic,
        )
        for t in way
        if t.moves
    ]


def _choose_odometry(
    index: RecordingIndex, options: ReadOptions, choice: Choice, name: str
) -> None:
    streams = sorted(index.with_role("odometry"), key=lambda s: _rank(s, _ODOMETRY_NAMES))
    chosen: Stream | None = None
    why = "the only odometry" if len(streams) == 1 else "the most likely wheel odometry"
    if options.odom_topic == NO_TOPIC:
        choice.reasons.update({s.topic: "no odometry is asked for" for s in streams})
        return
    if options.odom_topic is not None:
        chosen, why = _asked_for(index, options.odom_topic, "odometry", name), "asked for"
    else:
        moving = [stream for stream in streams if not _stands_still(stream)]
        for stream in streams:
            choice.reasons[stream.topic] = "its pose never changes"
        chosen = moving[0] if moving else _edge_of(index, choice)
        if chosen is not None and chosen.edge is not None:
            why = f"{' -> '.join(chosen.edge)} serves as odometry: no topic holds any"
    for stream in streams:
        if stream is not chosen and choice.reasons.get(stream.topic) != "its pose never changes":
            choice.reasons[stream.topic] = f"{chosen.topic if chosen else 'none'} is used"
        elif chosen is not None and stream is not chosen and not _stands_still(stream):
            choice.reasons[stream.topic] = f"{chosen.topic} is used; --odom-topic for this one"
    if chosen is None:
        return
    choice.reasons[chosen.topic] = why
    child = chosen.child_frame or choice.base_frame
    found = index.tree.lookup(child, choice.base_frame)
    if found is None:
        choice.findings.append(
            Finding(
                "warning",
                "missing_transform",
                f"no transform from {child} to {choice.base_frame}: {chosen.topic} is taken for "
                f"the way of {choice.base_frame}",
                "record /tf_static, or give --urdf FILE",
                chosen.topic,
            )
        )
    choice.odometry = OdometryChoice(chosen, found[0] if found else Pose3.identity())


def _stands_still(stream: Stream) -> bool:
    poses = {s.values for s in stream.samples if isinstance(s, OdometryMessage)}
    return len(stream.samples) > 3 and len(poses) == 1


def _edge_of(index: RecordingIndex, choice: Choice) -> Stream | None:
    """Return the poses on ``/tf`` of the base below an odometry frame, if they move."""
    above = index.tree.above(choice.base_frame)
    for edge in index.edges:
        parent, child = edge.edge or ("", "")
        transform = index.tree.transforms.get(child)
        moves = transform is not None and transform.parent == parent and transform.moves
        if moves and (child in above or len(index.edges) == 1):
            return edge
    return None


def _choose_imu(index: RecordingIndex, options: ReadOptions, choice: Choice, name: str) -> None:
    streams = index.with_role("imu")
    if options.imu_topic == NO_TOPIC:
        choice.reasons.update({s.topic: "no IMU is asked for" for s in streams})
        return
    if options.imu_topic is not None:
        streams = [_asked_for(index, options.imu_topic, "imu", name)]
    whole = []
    for stream in streams:
        if any(_is_whole(sample) for sample in stream.samples):
            whole.append(stream)
        else:
            choice.reasons[stream.topic] = "it measures no acceleration or no angular velocity"
    if not whole:
        return
    tree, base = index.tree, choice.base_frame
    whole.sort(key=lambda s: (tree.lookup(base, s.frame) is None, -len(s.stamps), s.topic))
    for stream in whole[1:]:
        choice.reasons[stream.topic] = f"{whole[0].topic} is used; --imu-topic for this one"
    stream = whole[0]
    found = tree.lookup(base, stream.frame)
    pose = found[0] if found else Pose3.identity()
    gravity = _mean_acceleration(stream)
    size = float(np.linalg.norm(gravity))
    scale = 9.80665 if 0.8 < size < 1.2 else 1.0
    if scale != 1.0:
        choice.findings.append(
            Finding(
                "warning",
                "acceleration_in_g",
                f"{stream.topic}: accelerations are in g ({size:.2f} on average), not in m/s^2",
                "multiplied by 9.80665; let the driver send m/s^2",
                stream.topic,
            )
        )
    if found is None and not _points_up(pose, gravity):
        choice.reasons[stream.topic] = (
            f"no transform from {base} to {stream.frame}, and its z axis does not point up"
        )
        return
    if found is None:
        choice.findings.append(
            Finding(
                "warning",
                "missing_transform",
                f"no transform from {base} to {stream.frame or 'the IMU'} ({stream.topic}): its "
                f"axes are taken for those of {base}",
                "record /tf_static, or give --urdf FILE",
                stream.topic,
            )
        )
    elif not _points_up(pose, gravity):
        choice.findings.append(
            Finding(
                "warning",
                "imu_upside_down",
                f"{stream.topic}: gravity does not point down in {base} on average",
                "correct the transform to the IMU, or give --imu-topic none",
                stream.topic,
            )
        )
    choice.reasons[stream.topic] = "asked for" if options.imu_topic else "the IMU"
    choice.imu = ImuChoice(stream, pose, scale)


def _is_whole(sample: object) -> bool:
    return (
        isinstance(sample, ImuMessage)
        and sample.linear_acceleration is not None
        and sample.angular_velocity is not None
    )


def _mean_acceleration(stream: Stream) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    values = [
        s.linear_acceleration
        for s in stream.samples
        if isinstance(s, ImuMessage) and s.linear_acceleration is not None
    ]
    sound = [v for v in values if all(abs(part) < _ABSURD for part in v)]
    array = np.array(sound).reshape(-1, 3)
    return array.mean(axis=0) if len(array) else np.zeros(3)


def _points_up(pose: Pose3, gravity: np.ndarray[tuple[int], np.dtype[np.float64]]) -> bool:
    size = float(np.linalg.norm(gravity))
    up = float((pose.rotation @ gravity)[2])
    return size > 0.0 and up > math.cos(_GRAVITY_MISFIT) * size
