# SPDX-License-Identifier: Apache-2.0
"""Reading trajectories back, and how far one is from another."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.errors import ConfigError, InputError
from cartoloop.evaluation.text_table import read_table
from cartoloop.sensor.pose import Pose, compose_all

_MAX_LENGTH_ERROR = 0.1  # of quaternions: written with few digits, they are not of length one


@dataclass(frozen=True)
class Trajectory:
    """Poses with the times that name them.

    Attributes
    ----------
    stamps : float64 (n,) [s], in file order, which may not be the order of time.
    poses : float64 (n, 3), x [m], y [m], theta [rad].
    """

    stamps: FloatArray
    poses: FloatArray

    def find(self, stamps: FloatArray, tolerance: float) -> NDArray[np.int64]:
        """Return the row nearest in time to each stamp, -1 where none is within `tolerance` [s].

        Of several poses with one stamp the first counts, of two equally near the earlier.

        Raises
        ------
        ConfigError
            `tolerance` is negative or no number.
        """
        if not tolerance >= 0.0:
            raise ConfigError(
                f"a tolerance of {tolerance:g} s between stamps is impossible: give 0 s or more"
            )
        if len(self.stamps) == 0:
            return np.full(len(stamps), -1, dtype=np.int64)
        # Recorded stamps may run backwards, and then a search in file order misses them.
        order = np.argsort(self.stamps, kind="stable")
        ordered = self.stamps[order]
        place = np.searchsorted(ordered, stamps)
        # looked up once more, to have the first of several with the same stamp
        after = np.searchsorted(ordered, ordered[np.minimum(place, len(ordered) - 1)])
        before = np.searchsorted(ordered, ordered[np.maximum(place - 1, 0)])
        nearest = np.where(
            np.abs(ordered[after] - stamps) < np.abs(ordered[before] - stamps), after, before
        )
        found = np.abs(ordered[nearest] - stamps) <= tolerance
        return np.where(found, order[nearest], -1).astype(np.int64)


def read_tum(path: str | PathLike[str]) -> Trajectory:
    """Return the trajectory in a TUM file: ``stamp tx ty tz qx qy qz qw`` a line, ``#`` comments.

    Raises
    ------
    InputError
        The file cannot be read, holds no pose, or a line is not eight finite numbers, the last
        four a quaternion of about unit length (files of relations have eight numbers as well).
    """
    table, places = read_table(path, "stamp tx ty tz qx qy qz qw")
    lengths = np.linalg.norm(table[:, 4:], axis=1)
    for row in np.flatnonzero(np.abs(lengths - 1.0) > _MAX_LENGTH_ERROR)[:1].tolist():
        raise InputError(
            f"{places[row]}: qx qy qz qw is of length {lengths[row]:.3g}, not 1; expected a "
            "trajectory, lines of 'stamp tx ty tz qx qy qz qw'"
        )
    qx, qy, qz, qw = table[:, 4:].T
    yaw = np.arctan2(2.0 * (qw * qz + qx * qy), qw * qw + qx * qx - qy * qy - qz * qz)
    return Trajectory(stamps=table[:, 0], poses=np.column_stack((table[:, 1:3], yaw)))


def align(points: FloatArray, reference: FloatArray, weights: FloatArray | None = None) -> Pose:
    """Return tf_reference_points, the rigid transform that brings points to their reference.

    Parameters
    ----------
    points, reference : float64 (n, 2) [m], row by row the same places, n > 0.
    weights : float64 (n,), not negative; all the same by default.

    Notes
    -----
    Least squares in closed form: Horn's method in the plane, O(n).
    """
    centre, centre_reference = (
        np.average(each, axis=0, weights=weights) for each in (points, reference)
    )
    a, b = points - centre, reference - centre_reference
    if weights is not None:
        b = b * weights[:, np.newaxis]
    theta = float(np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b)))
    cos, sin = np.cos(theta), np.sin(theta)
    return Pose(
        float(centre_reference[0] - cos * centre[0] + sin * centre[1]),
        float(centre_reference[1] - sin * centre[0] - cos * centre[1]),
        theta,
    )


def absolute_trajectory_error(
    estimate: FloatArray, truth: FloatArray, *, aligned: bool = True
) -> FloatArray:
    """Return the distance [m] of each estimated position from the true one, shape (n,).

    Parameters
    ----------
    estimate, truth : float64 (n, 3), row by row at the same times, n > 0.
    aligned : whether the estimate is first brought to the truth as a rigid whole.
    """
    if aligned:
        tf_truth_estimate = align(estimate[:, :2], truth[:, :2])
        estimate = compose_all(np.array(tf_truth_estimate), estimate)
    error: FloatArray = np.hypot(*(estimate[:, :2] - truth[:, :2]).T)
    return error
