# SPDX-License-Identifier: Apache-2.0
"""Which odometry and which IMU of a recording are used, and why."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop.readers.read_options import NO_TOPIC, ReadOptions
from cartoloop.readers.ros.chosen import (
    ODOMETRY_NAMES,
    Choice,
    ImuChoice,
    OdometryChoice,
    asked_for,
    rank,
)
from cartoloop.readers.ros.index import RecordingIndex, Stream
from cartoloop.readers.ros.inventory import BagFinding
from cartoloop.readers.ros.messages import ImuMessage, OdometryMessage
from cartoloop.readers.ros.transforms import Pose3

FloatArray = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665
"""One g [m/s^2]."""

FASTEST_TURN = 35.0
"""No gyroscope in use measures more [rad/s]; larger numbers are degrees."""

_ABSURD = 1e6  # m/s^2, rad/s
_MIN_FAST = 3  # times that it turns faster than that in the sample, to believe it
_WEAKEST_GRAVITY = 5.0  # m/s^2
_GRAVITY_MISFIT = math.radians(45.0)


def choose_odometry(index: RecordingIndex, options: ReadOptions, choice: Choice, name: str) -> None:
    """Add the odometry to a choice whose base frame is known: a topic, else a moving transform.

    Raises
    ------
    InputError
        The topic asked for holds none.
    """
    streams = sorted(index.with_role("odometry"), key=lambda s: rank(s, ODOMETRY_NAMES))
    if options.odom_topic == NO_TOPIC:
        choice.reasons.update({s.topic: "no odometry is asked for" for s in streams})
        return
    moving = [stream for stream in streams if not _stands_still(stream)]
    if options.odom_topic is not None:
        chosen: Stream | None = asked_for(index, options.odom_topic, "odometry", name)
        why = "asked for"
    elif moving:
        chosen = moving[0]
        why = "the only odometry" if len(streams) == 1 else "the most likely wheel odometry"
    else:
        chosen = _edge_of(index, choice)
        edge = " -> ".join(chosen.edge or ()) if chosen is not None else ""
        why = f"{edge} serves as odometry: no topic holds any"
    for stream in streams:
        other = f"{chosen.topic} is used; --odom-topic for this one" if chosen else ""
        choice.reasons[stream.topic] = other if stream in moving else "its pose never changes"
    if chosen is None:
        return
    choice.reasons[chosen.topic] = why
    child = chosen.child_frame or choice.base_frame
    found = index.tree.lookup(child, choice.base_frame)
    if found is None:
        choice.findings.append(
            BagFinding(
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


def choose_imu(index: RecordingIndex, options: ReadOptions, choice: Choice, name: str) -> None:
    """Add the IMU to a choice whose base frame is known.

    Raises
    ------
    InputError
        The topic asked for holds no readings.
    """
    streams = index.with_role("imu")
    if options.imu_topic == NO_TOPIC:
        choice.reasons.update({s.topic: "no IMU is asked for" for s in streams})
        return
    for stream in streams:
        choice.reasons[stream.topic] = "it measures no acceleration or no angular velocity"
    whole = [s for s in streams if any(_is_whole(sample) for sample in s.samples)]
    if options.imu_topic is not None:
        asked = asked_for(index, options.imu_topic, "imu", name)
        whole = [s for s in whole if s is asked]
    if not whole:
        return
    tree, base = index.tree, choice.base_frame
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
        return
    choice.findings += _imu_doubts(stream, base, pose, gravity, is_placed=found is not None)
    choice.reasons[stream.topic] = "asked for" if options.imu_topic else "the IMU"
    choice.imu = ImuChoice(
        stream,
        pose,
        acceleration_scale=STANDARD_GRAVITY if _is_in_g(_usual_acceleration(stream)) else 1.0,
        velocity_scale=math.radians(1.0) if _is_in_degrees(stream) else 1.0,
    )


def _imu_doubts(
    stream: Stream, base: str, pose: Pose3, gravity: FloatArray, *, is_placed: bool
) -> list[BagFinding]:
    """Return what is doubtful about an IMU that is used all the same; gravity in m/s^2."""
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


def _fastest_turn(stream: Stream) -> float:
    """Return the largest angular velocity of the sample that is no glitch, of whatever unit."""
    velocities = [s.angular_velocity for s in stream.samples if isinstance(s, ImuMessage)]
    sizes = [math.hypot(*velocity) for velocity in velocities if velocity is not None]
    # Successive readings are alike; one that stands alone is wrong.
    threes = zip(sizes[::3], sizes[1::3], sizes[2::3], strict=False)
    middles = [sorted(three)[1] for three in threes]
    sound = sorted((size for size in middles if size < _ABSURD), reverse=True)
    return next(iter(sound[_MIN_FAST - 1 :]), 0.0)


def _is_in_degrees(stream: Stream) -> bool:
    return _fastest_turn(stream) > FASTEST_TURN


def _is_whole(sample: object) -> bool:
    return (
        isinstance(sample, ImuMessage)
        and sample.linear_acceleration is not None
        and sample.angular_velocity is not None
    )


def _usual_acceleration(stream: Stream) -> FloatArray:
    values = [
        s.linear_acceleration
        for s in stream.samples
        if isinstance(s, ImuMessage) and s.linear_acceleration is not None
    ]
    sound = [v for v in values if all(abs(part) < _ABSURD for part in v)]
    array = np.array(sound).reshape(-1, 3)
    return np.median(array, axis=0) if len(array) else np.zeros(3)


def _points_up(pose: Pose3, gravity: FloatArray) -> bool:
    size = float(np.linalg.norm(gravity))
    up = float((pose.rotation @ gravity)[2])
    return size > 0.0 and up > math.cos(_GRAVITY_MISFIT) * size
