# SPDX-License-Identifier: Apache-2.0
"""The motion of a map as a whole that takes its points to surveyed ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.sensor.pose import Pose, transform_points

MIN_SPREAD_M = 0.1
"""Points that are closer together do not show by how much the map is turned [m]."""

LARGE_RESIDUAL_M, LARGE_SHARE = 0.5, 0.02
"""A residual of more than this, and than this share of the distance between the points, is no error
of a map [m]: a point is another one, or mistyped."""

LARGE_SCALE_ERROR = 0.05
"""No map is larger or smaller than the survey by this share, and by more than a point may be off:
a scanner measures lengths better."""


@dataclass(frozen=True, slots=True)
class PointFit:
    """How a map was moved to surveyed points.

    Attributes
    ----------
    tf_surveyed_map : the motion.
    residuals : float64, shape (n, 2), surveyed minus moved positions [m].
    scale : by which the map would have to grow to fit best; it does not.
    spread : twice the distance of the farthest surveyed point from their middle [m].
    """

    tf_surveyed_map: Pose
    residuals: FloatArray
    scale: float
    spread: float

    @property
    def larger(self) -> float:
        """By which share the map is larger than the survey, negative where it is smaller."""
        return 1.0 / self.scale - 1.0 if self.scale > 0.0 else math.inf

    @property
    def is_doubtful(self) -> bool:
        """Whether the points agree so badly that one of them is probably wrong."""
        largest = float(self.distances.max())
        limit = max(LARGE_RESIDUAL_M, LARGE_SHARE * self.spread)
        too_long = abs(self.larger) * self.spread
        is_scaled = abs(self.larger) > LARGE_SCALE_ERROR and too_long > LARGE_RESIDUAL_M
        return largest > limit or is_scaled

    @property
    def distances(self) -> FloatArray:
        """Lengths of the residuals, shape (n,) [m]."""
        return np.hypot(self.residuals[:, 0], self.residuals[:, 1])


def fit_points(places: FloatArray, surveyed: FloatArray) -> PointFit:
    """Return the rotation and translation of least squares, without a change of scale.

    Parameters
    ----------
    places, surveyed : shape (n, 2), n >= 2 [m].

    Raises
    ------
    ValueError
        The points lie within :data:`MIN_SPREAD_M`.

    Notes
    -----
    S. Umeyama, Least-squares estimation of transformation parameters between two point patterns,
    PAMI 1991; in the plane the rotation is the angle of the sum of products.
    """
    from_centre, to_centre = places - places.mean(axis=0), surveyed - surveyed.mean(axis=0)
    for points, whose in ((from_centre, "of the map"), (to_centre, "surveyed")):
        if np.hypot(points[:, 0], points[:, 1]).max() < MIN_SPREAD_M / 2.0:
            raise ValueError(
                f"the points {whose} lie within {MIN_SPREAD_M:g} m: give points far apart"
            )
    cross = from_centre[:, 0] * to_centre[:, 1] - from_centre[:, 1] * to_centre[:, 0]
    dot = float(np.sum(from_centre * to_centre))
    angle = math.atan2(float(np.sum(cross)), dot)
    turned = transform_points(Pose(0.0, 0.0, angle), places.mean(axis=0)[np.newaxis])[0]
    x, y = (surveyed.mean(axis=0) - turned).tolist()
    tf_surveyed_map = Pose(x, y, angle)
    scale = math.hypot(float(np.sum(cross)), dot) / float(np.sum(from_centre**2))
    residuals = surveyed - transform_points(tf_surveyed_map, places)
    spread = 2.0 * float(np.hypot(to_centre[:, 0], to_centre[:, 1]).max())
    return PointFit(tf_surveyed_map, residuals, scale, spread)
