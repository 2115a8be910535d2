# SPDX-License-Identifier: Apache-2.0
"""Which IMU of a recording is used, and why; its units and its mounting are checked."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.readers.read_options import NO_TOPIC, ReadOptions
from cartoloop.readers.ros.container import BagFinding
from cartoloop.readers.ros.index import RecordingIndex, TopicStream
from cartoloop.readers.ros.raw_messages import RawImu
from cartoloop.readers.ros.transforms import Pose3

STANDARD_GRAVITY = 9.80665
"""One g [m/s^2]."""

FASTEST_TURN = 35.0
"""No gyroscope in use measures more [rad/s]; larger numbers are degrees."""

ABSURD_READING = 1e6
"""Larger readings come from damaged messages [m/s^2], [rad/s]."""

_MIN_FAST = 3
"""Readings faster than `FASTEST_TURN` in the sample, to take the unit for degrees."""

_WEAKEST_GRAVITY = 5.0
"""Mean accelerations below this lack gravity [m/s^2]: half of it, for a robot that also drives."""

_GRAVITY_MISFIT = math.radians(45.0)
"""A mean acceleration farther from upright than this is a wrong mounting, not a slope [rad]."""


@dataclass(frozen=True, eq=False)
class ImuChoice:
    """The IMU in use, its pose in the base frame, and the factors of its readings."""

    stream: TopicStream
    tf_base_sensor: Pose3
    acceleration_scale: float = 1.0
    velocity_scale: float = 1.0


@dataclass(eq=False)
class ImuSelection:
    """Result of the choice: the IMU or None, why each topic is used or not, and doubts."""

    imu: ImuChoice | None = None
    reasons: dict[str, str] = field(default_factory=dict)
    findings: list[BagFinding] = field(default_factory=list)


def choose_imu(index: RecordingIndex, options: ReadOptions, base: str, name: str) -> ImuSelection:
    """Choose the IMU.

    Parameters
    ----------
    base : the tracking frame.
    name : of the recording, for messages.

    Raises
    ------
    InputError
        The topic asked for holds no readings.
    """
    choice = ImuSelection()
    streams = index.with_role("imu")
    if options.imu_topic == NO_TOPIC:
        choice.reasons.update({s.topic: "no IMU is asked for" for s in streams})
        return choice
    for stream in streams:
        choice.reasons[stream.topic] = "it measures no acceleration or no angular velocity"
    whole = [s for s in streams if any(_is_whole(sample) for sample in s.samples)]
    if options.imu_topic is not None:
        asked = index.named(options.imu_topic, "imu", name)
        whole = [s for s in whole if s is asked]
    if not whole:
        return choice
    tree = index.tree
    whole.sort(key=lambda s: (tree.lookup(base, s.frame) is None, -len(s.stamps), s.topic))
    for stream in whole[1:]:
        choice.reasons[stream.topic] = f"{whole[0].topic} is used; --imu-topic for this one"
    stream = whole[0]
    found = tree.lookup(base, stream.frame)
    pose = found[0] if found else Pose3.identity()
    gravity = _usual_acceleration(stream)
    if _is_in_g(gravity):
        gravity = gravity * STANDARD_GRAVITY
    if found is None and not _points_up(pose, gravity):
        which = "does not point up" if _is_felt(gravity) else "is not known without gravity"
        choice.reasons[stream.topic] = (
            f"no transform from {base} to {stream.frame}, and its z axis {which}"
        )
        return choice
    choice.findings += _imu_doubts(stream, base, pose, gravity, is_placed=found is not None)
    choice.reasons[stream.topic] = "asked for" if options.imu_topic else "the IMU"
    choice.imu = ImuChoice(
        stream,
        pose,
        acceleration_scale=STANDARD_GRAVITY if _is_in_g(_usual_acceleration(stream)) else 1.0,
        velocity_scale=math.radians(1.0) if _is_in_degrees(stream) else 1.0,
    )
    return choice


def _imu_doubts(
    stream: TopicStream, base: str, pose: Pose3, gravity: FloatArray, *, is_placed: bool
) -> list[BagFinding]:
    """Return the findings about an IMU that is used; gravity in m/s^2."""
    doubts = []
    if _is_in_g(_usual_acceleration(stream)):
        size = np.linalg.norm(_usual_acceleration(stream))
        doubts.append((
            "acceleration_in_g",
            f"{stream.topic}: accelerations are in g ({size:.2f} on average), not in m/s^2",
            f"multiplied by {STANDARD_GRAVITY}; let the driver send m/s^2",
        ))  # fmt: skip
    if _is_in_degrees(stream):
        doubts.append((
            "velocity_in_degrees",
            f"{stream.topic}: angular velocities reach {_fastest_turn(stream):.0f}: they are in "
            "deg/s, not in rad/s",
            "converted; let the driver send rad/s",
        ))  # fmt: skip
    if not is_placed:
        doubts.append((
            "missing_transform",
            f"no transform from {base} to {stream.frame or 'the IMU'} ({stream.topic}): its "
            f"axes are taken for those of {base}",
            "record /tf_static, or give --urdf FILE",
        ))  # fmt: skip
    elif not _is_felt(gravity):
        doubts.append((
            "no_gravity",
            f"{stream.topic}: accelerations are {np.linalg.norm(gravity):.2f} m/s^2 on average, "
            "without gravity",
            "only its angular velocity is used; let the driver send accelerations as measured",
        ))  # fmt: skip
    elif not _points_up(pose, gravity):
        doubts.append((
            "imu_upside_down",
            f"{stream.topic}: gravity does not point down in {base} on average",
            "correct the transform to the IMU, or give --imu-topic none",
        ))  # fmt: skip
    return [
        BagFinding("warning", code, message, remedy, stream.topic)
        for code, message, remedy in doubts
    ]


def _is_in_g(gravity: FloatArray) -> bool:
    return bool(0.8 < np.linalg.norm(gravity) < 1.2)


def _is_felt(gravity: FloatArray) -> bool:
    return bool(np.linalg.norm(gravity) > _WEAKEST_GRAVITY)


def _fastest_turn(stream: TopicStream) -> float:
    """Return the largest angular velocity of the sample that is no outlier, in the unit sent."""
    velocities = [s.angular_velocity for s in stream.samples if isinstance(s, RawImu)]
    sizes = [math.hypot(*velocity) for velocity in velocities if velocity is not None]
    # Successive readings are alike; the median of three removes single wrong ones.
    threes = zip(sizes[::3], sizes[1::3], sizes[2::3], strict=False)
    middles = [sorted(three)[1] for three in threes]
    sound = sorted((size for size in middles if size < ABSURD_READING), reverse=True)
    return next(iter(sound[_MIN_FAST - 1 :]), 0.0)


def _is_in_degrees(stream: TopicStream) -> bool:
    return _fastest_turn(stream) > FASTEST_TURN


def _is_whole(sample: object) -> bool:
    return (
        isinstance(sample, RawImu)
        and sample.linear_acceleration is not None
        and sample.angular_velocity is not None
    )


def _usual_acceleration(stream: TopicStream) -> FloatArray:
    values = [
        s.linear_acceleration
        for s in stream.samples
        if isinstance(s, RawImu) and s.linear_acceleration is not None
    ]
    sound = [v for v in values if all(abs(part) < ABSURD_READING for part in v)]
    array = np.array(sound).reshape(-1, 3)
    return np.median(array, axis=0) if len(array) else np.zeros(3)


def _points_up(pose: Pose3, gravity: FloatArray) -> bool:
    size = float(np.linalg.norm(gravity))
    up = float((pose.rotation @ gravity)[2])
    return size > 0.0 and up > math.cos(_GRAVITY_MISFIT) * size
