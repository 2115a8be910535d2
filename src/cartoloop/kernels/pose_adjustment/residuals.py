# SPDX-License-Identifier: Apache-2.0
"""Residual and information of a constraint in the map frame (eq. 4, 5).

Notes
-----
Eq. (5) is printed with the wrong sign in the translation; meant is where b is seen from a,
e = xi_ij - (R_a^-1 (t_b - t_a), theta_b - theta_a). Rotated into the map frame it becomes
e' = (R_a z_t - d, z_theta - theta_b + theta_a) with d = t_b - t_a, and its derivatives need no
trigonometry: by the pose of b minus the identity, by the pose of a

    T = [[1, 0, -d_y], [0, 1, d_x], [0, 0, 1]].

E^2 does not change if the information matrix is rotated as well.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray, IntArray

_FULL_TURN = 2.0 * math.pi


@kernel
def residual_in_map(
    dx: float,
    dy: float,
    turn: float,
    cos_a: float,
    sin_a: float,
    measured_x: float,
    measured_y: float,
    measured_theta: float,
) -> tuple[float, float, float]:
    """Return e' of the module's notes [m, m, rad]; its angle is in [-pi, pi).

    Parameters
    ----------
    dx, dy, turn : float64, from a to b [m, m, rad], map frame.
    cos_a, sin_a : float64, of the angle of a.
    measured_x, measured_y, measured_theta : float64, tf_a_b as measured.
    """
    et = measured_theta - turn
    return (
        cos_a * measured_x - sin_a * measured_y - dx,
        sin_a * measured_x + cos_a * measured_y - dy,
        et - _FULL_TURN * np.floor((et + math.pi) * (1.0 / _FULL_TURN)),
    )


@kernel
def information_in_map(
    cos_a: float, sin_a: float, xx: float, xy: float, xt: float, yy: float, yt: float
) -> tuple[float, float, float, float, float]:
    """Return xx, xy, xt, yy, yt of an information matrix rotated from the frame of a to the map's.

    The last element, tt, does not change.
    """
    cos2, sin2, cross = cos_a * cos_a, sin_a * sin_a, cos_a * sin_a
    return (
        cos2 * xx + sin2 * yy - 2.0 * cross * xy,
        cross * (xx - yy) + (cos2 - sin2) * xy,
        cos_a * xt - sin_a * yt,
        sin2 * xx + cos2 * yy + 2.0 * cross * xy,
        sin_a * xt + cos_a * yt,
    )


class Residuals(NamedTuple):
    """Residuals of some constraints at the current poses.

    Attributes
    ----------
    translation : float64, (n,), length of the translation of e of eq. (5) [m].
    rotation : float64, (n,), size of its rotation [rad].
    squared : float64, (n,), E^2 of eq. (4).
    """

    translation: FloatArray
    rotation: FloatArray
    squared: FloatArray


@kernel
def measure_residuals(
    poses: FloatArray,
    vertex_a: IntArray,
    vertex_b: IntArray,
    tf_a_b: FloatArray,
    informations: FloatArray,
    out: Residuals,
) -> None:
    """Write the residuals of constraints into `out`.

    Parameters
    ----------
    poses : float64, shape (num_vertices, 3) [m, m, rad], map frame.
    vertex_a, vertex_b : int64, shape (n,).
    tf_a_b : float64, shape (n, 3) [m, m, rad], as measured.
    informations : float64, shape (n, 3, 3), frame of a.
    """
    out_translation, out_rotation, out_squared = out.translation, out.rotation, out.squared
    for i in range(vertex_a.size):
        a, b = vertex_a[i], vertex_b[i]
        cos_a, sin_a = math.cos(poses[a, 2]), math.sin(poses[a, 2])
        ex, ey, et = residual_in_map(
            poses[b, 0] - poses[a, 0],
            poses[b, 1] - poses[a, 1],
            poses[b, 2] - poses[a, 2],
            cos_a,
            sin_a,
            tf_a_b[i, 0],
            tf_a_b[i, 1],
            tf_a_b[i, 2],
        )
        information = informations[i]
        xx, xy, xt, yy, yt = information_in_map(
            cos_a,
            sin_a,
            information[0, 0],
            information[0, 1],
            information[0, 2],
            information[1, 1],
            information[1, 2],
        )
        squared = (
            ex * (xx * ex + 2.0 * (xy * ey + xt * et))
            + ey * (yy * ey + 2.0 * yt * et)
            + information[2, 2] * et * et
        )
        out_translation[i] = math.sqrt(ex * ex + ey * ey)
        out_rotation[i] = abs(et)
        out_squared[i] = max(squared, 0.0)  # rounding may leave a semidefinite form below zero
