# SPDX-License-Identifier: Apache-2.0
"""Poses of frames in space, and the tree of the transforms in a recording."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.sensor.pose import Pose

Origin = Literal["urdf", "robot_description", "tf_static", "tf"]

ABSURD_METERS = 1e9
"""Larger numbers come from damaged messages and would overflow later [m]."""

MOVES_METERS = 0.005
MOVES_RADIANS = math.radians(0.5)
"""A transform that changes by more than this is not fixed [m], [rad]: rounding changes it less."""


@dataclass(frozen=True, eq=False)
class Pose3:
    """A pose in space, of child in parent: ``p_parent = rotation @ p_child + translation``.

    Attributes
    ----------
    rotation : float64, shape (3, 3).
    translation : float64, shape (3,) [m].
    """

    rotation: FloatArray
    translation: FloatArray

    @staticmethod
    def identity() -> Pose3:
        """Return the pose of a frame in itself."""
        return Pose3(np.eye(3), np.zeros(3))

    @staticmethod
    def from_quaternion(translation: tuple[float, ...], quaternion: tuple[float, ...]) -> Pose3:
        """Return the pose of translation x y z [m] and quaternion x y z w, of any length.

        Raises
        ------
        ValueError
            A number is not finite or absurd, or the quaternion is 0.
        """
        norm = math.hypot(*quaternion)
        farthest = max(map(abs, translation))
        if not (1e-6 < norm < ABSURD_METERS and farthest < ABSURD_METERS):
            raise ValueError("no pose")
        x, y, z, w = (value / norm for value in quaternion)
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        return Pose3(rotation, np.array(translation, dtype=np.float64))

    @staticmethod
    def from_rpy(translation: tuple[float, ...], roll: float, pitch: float, yaw: float) -> Pose3:
        """Return the pose of translation [m] and Rz(yaw) Ry(pitch) Rx(roll) [rad]."""
        cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
        cy, sy = math.cos(yaw), math.sin(yaw)
        rotation = np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )
        return Pose3(rotation, np.array(translation, dtype=np.float64))

    @staticmethod
    def from_plane(pose: Pose) -> Pose3:
        """Return the pose in space of a pose in the plane."""
        return Pose3.from_rpy((pose.x, pose.y, 0.0), 0.0, 0.0, pose.theta)

    def __matmul__(self, other: Pose3) -> Pose3:
        """Return ``tf_a_b @ tf_b_c``, which is tf_a_c."""
        return Pose3(
            self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
        )

    def inverse(self) -> Pose3:
        """Return the pose of parent in child."""
        return Pose3(self.rotation.T, -self.rotation.T @ self.translation)

    @property
    def rpy(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw [rad] with ``rotation == Rz(yaw) Ry(pitch) Rx(roll)``."""
        r = self.rotation
        pitch = math.asin(min(1.0, max(-1.0, -float(r[2, 0]))))
        if abs(r[2, 0]) > 1.0 - 1e-9:  # pitch of 90 degrees: only the sum of roll and yaw is known
            return 0.0, pitch, math.atan2(-r[0, 1], r[1, 1])
        return math.atan2(r[2, 1], r[2, 2]), pitch, math.atan2(r[1, 0], r[0, 0])

    @property
    def plane(self) -> Pose:
        """The pose as seen from above."""
        return Pose(float(self.translation[0]), float(self.translation[1]), self.rpy[2])

    def distance(self, other: Pose3) -> tuple[float, float]:
        """Return the distance [m] and the angle [rad] between two poses."""
        trace = float(np.trace(self.rotation.T @ other.rotation))
        turn = math.acos(min(1.0, max(-1.0, 0.5 * (trace - 1.0))))
        return float(np.linalg.norm(self.translation - other.translation)), turn


@dataclass(eq=False)
class FrameTransform:
    """The pose of one frame in another, as recorded.

    Attributes
    ----------
    parent, child : names of the frames.
    origin : where it was stated.
    pose : of child in parent, when first seen.
    count : number of messages with it.
    moved_m, moved_rad : largest distance from the first pose.
    """

    parent: str
    child: str
    origin: Origin
    pose: Pose3
    count: int = 1
    moved_m: float = 0.0
    moved_rad: float = 0.0
    last_values: tuple[float, ...] = ()

    @property
    def moves(self) -> bool:
        """Whether it is not a fixed mounting."""
        return self.moved_m > MOVES_METERS or self.moved_rad > MOVES_RADIANS


class TransformTree:
    """All transforms of a recording. Each frame has one parent: the first one stated.

    Attributes
    ----------
    transforms : by the name of the child.
    conflicts : child, and the other parents that are stated for it.
    """

    def __init__(self) -> None:
        self.transforms: dict[str, FrameTransform] = {}
        self.conflicts: dict[str, set[str]] = {}

    def add(self, parent: str, child: str, pose: Pose3, origin: Origin) -> FrameTransform | None:
        """Add a transform; return it if it is the first of this child."""
        if child in self.transforms:
            known = self.transforms[child]
            if known.parent != parent:
                self.conflicts.setdefault(child, set()).add(parent)
            elif known.origin == origin:
                meters, radians = known.pose.distance(pose)
                known.moved_m = max(known.moved_m, meters)
                known.moved_rad = max(known.moved_rad, radians)
            return None
        # A loop would leave frames without a root.
        if child == parent or parent in self.below(child):
            return None
        self.transforms[child] = FrameTransform(parent, child, origin, pose)
        return self.transforms[child]

    def add_sent(self, parent: str, child: str, values: tuple[float, ...], origin: Origin) -> None:
        """Add a transform as sent: x y z [m], quaternion x y z w.

        Raises
        ------
        ValueError
            A number is not finite, or the quaternion is 0.
        """
        known = self.transforms.get(child)
        if known is not None and known.parent == parent and known.origin == origin:
            known.count += 1
            if known.last_values == values:
                return  # mostly the same pose is sent repeatedly
        pose = Pose3.from_quaternion(values[:3], values[3:])
        self.add(parent, child, pose, origin)
        known = self.transforms.get(child)
        if known is not None and known.parent == parent and known.origin == origin:
            known.last_values = values

    @property
    def frames(self) -> set[str]:
        """Names of all frames."""
        return set(self.transforms) | {t.parent for t in self.transforms.values()}

    def above(self, frame: str) -> list[str]:
        """Return the frame, its parent, and so on up to the root."""
        chain = [frame]
        while chain[-1] in self.transforms:
            chain.append(self.transforms[chain[-1]].parent)
        return chain

    def below(self, frame: str) -> set[str]:
        """Return the frame and all frames below it."""
        found = {frame}
        grown = True
        while grown:
            more = {c for c, t in self.transforms.items() if t.parent in found} - found
            found |= more
            grown = bool(more)
        return found

    def lookup(self, target: str, source: str) -> tuple[Pose3, list[FrameTransform]] | None:
        """Return tf_target_source and the transforms between them; None if not connected."""
        up_target, up_source = self.above(target), self.above(source)
        common = next((frame for frame in up_source if frame in up_target), None)
        if common is None:
            return None
        between: list[FrameTransform] = []
        poses = []
        for chain in (up_target, up_source):
            pose = Pose3.identity()
            for frame in chain[: chain.index(common)]:
                between.append(self.transforms[frame])
                pose = self.transforms[frame].pose @ pose
            poses.append(pose)
        return poses[0].inverse() @ poses[1], between
