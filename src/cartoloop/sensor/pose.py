# SPDX-License-Identifier: Apache-2.0
"""Rigid transforms of the plane, SE(2), eq. (1) of the paper.

A transform ``tf_target_source`` takes coordinates in the frame *source* to the frame *target*; it
is also the pose of *source* in *target*. Neighbours cancel:
``tf_map_scan = compose(tf_map_submap, tf_submap_scan)``.

Single transforms are :class:`Pose` tuples (cheap in Python); many at once are float64 arrays of
shape (n, 3) with columns x [m], y [m], theta [rad]. Angles are in (-pi, pi].
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray as FloatArray  # noqa: PLC0414 - still imported from here


class Pose(NamedTuple):
    """A rigid transform of the plane: translation x, y [m] and rotation theta [rad]."""

    x: float
    y: float
    theta: float


quick_pose: Callable[[tuple[float, float, float]], Pose] = partial(tuple.__new__, Pose)
"""Makes a pose of three numbers in half of the time that `Pose` takes: scans need dozens each."""

IDENTITY = Pose(0.0, 0.0, 0.0)


def wrap_angle(angle: float) -> float:
    """Return the angle [rad] in (-pi, pi]."""
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


def compose(tf_a_b: Pose, tf_b_c: Pose) -> Pose:
    """Return tf_a_c, the transform that applies `tf_b_c` first and `tf_a_b` second."""
    b_x, b_y, b_theta = tf_a_b
    x, y, theta = tf_b_c
    cos, sin = math.cos(b_theta), math.sin(b_theta)
    turned = math.remainder(b_theta + theta, math.tau)  # `wrap_angle`, without a call
    turned = math.pi if turned == -math.pi else turned
    return quick_pose((b_x + cos * x - sin * y, b_y + sin * x + cos * y, turned))


def inverse(tf_a_b: Pose) -> Pose:
    """Return tf_b_a."""
    x, y, theta = tf_a_b
    cos, sin = math.cos(theta), math.sin(theta)
    return quick_pose((-(cos * x + sin * y), sin * x - cos * y, wrap_angle(-theta)))


def relative(tf_a_b: Pose, tf_a_c: Pose) -> Pose:
    """Return tf_b_c, the pose of c in b: ``compose(inverse(tf_a_b), tf_a_c)``."""
    b_x, b_y, b_theta = tf_a_b
    c_x, c_y, c_theta = tf_a_c
    cos, sin = math.cos(b_theta), math.sin(b_theta)
    dx, dy = c_x - b_x, c_y - b_y
    turn = math.remainder(c_theta - b_theta, math.tau)
    turn = math.pi if turn == -math.pi else turn
    return quick_pose((cos * dx + sin * dy, cos * dy - sin * dx, turn))


def interpolate(tf_a_b: Pose, tf_a_c: Pose, fraction: float) -> Pose:
    """Return the pose at a `fraction` from b to c, straight in x, y, by less than pi in theta."""
    b_x, b_y, b_theta = tf_a_b
    c_x, c_y, c_theta = tf_a_c
    turn = math.remainder(c_theta - b_theta, math.tau)
    turn = math.pi if turn == -math.pi else turn
    theta = math.remainder(b_theta + fraction * turn, math.tau)
    theta = math.pi if theta == -math.pi else theta
    return quick_pose((b_x + fraction * (c_x - b_x), b_y + fraction * (c_y - b_y), theta))


def transform_points(tf_a_b: Pose, points_b: FloatArray) -> FloatArray:
    """Return points of shape (n, 2) [m] in frame b as points in frame a."""
    cos, sin = math.cos(tf_a_b.theta), math.sin(tf_a_b.theta)
    x, y = points_b[:, 0], points_b[:, 1]
    points_a = np.empty((len(points_b), 2))
    points_a[:, 0] = tf_a_b.x + cos * x - sin * y
    points_a[:, 1] = tf_a_b.y + sin * x + cos * y
    return points_a


def wrap_angles(angles: FloatArray) -> FloatArray:
    """Return angles [rad] of any shape in (-pi, pi]; angles already there keep every bit."""
    wrapped = angles - math.tau * np.rint(angles / math.tau)
    # Rounding may leave an angle just outside, and -pi stays -pi.
    wrapped = np.where(wrapped <= -math.pi, wrapped + math.tau, wrapped)
    return np.where(wrapped > math.pi, wrapped - math.tau, wrapped)


def compose_all(tf_a_b: FloatArray, tf_b_c: FloatArray) -> FloatArray:
    """Return tf_a_c row by row; both of shape (n, 3), or one of them (3,) for all rows."""
    tf_a_b, tf_b_c = np.atleast_2d(tf_a_b), np.atleast_2d(tf_b_c)
    cos, sin = np.cos(tf_a_b[:, 2]), np.sin(tf_a_b[:, 2])
    return np.column_stack(
        (
            tf_a_b[:, 0] + cos * tf_b_c[:, 0] - sin * tf_b_c[:, 1],
            tf_a_b[:, 1] + sin * tf_b_c[:, 0] + cos * tf_b_c[:, 1],
            wrap_angles(tf_a_b[:, 2] + tf_b_c[:, 2]),
        )
    )


def relative_all(tf_a_b: FloatArray, tf_a_c: FloatArray) -> FloatArray:
    """Return tf_b_c row by row; both of shape (n, 3), or one of them (3,) for all rows."""
    tf_a_b, tf_a_c = np.atleast_2d(tf_a_b), np.atleast_2d(tf_a_c)
    cos, sin = np.cos(tf_a_b[:, 2]), np.sin(tf_a_b[:, 2])
    dx, dy = tf_a_c[:, 0] - tf_a_b[:, 0], tf_a_c[:, 1] - tf_a_b[:, 1]
    return np.column_stack(
        (cos * dx + sin * dy, cos * dy - sin * dx, wrap_angles(tf_a_c[:, 2] - tf_a_b[:, 2]))
    )
