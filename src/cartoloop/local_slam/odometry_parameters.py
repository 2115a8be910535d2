# SPDX-License-Identifier: Apache-2.0
"""What is known about the odometry: offset of its clock, scales, veer, yaw and lever arm."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import PredictionConfig
from cartoloop.local_slam.odometry_veer import NO_VEER, Veer
from cartoloop.local_slam.prediction import isotropic_information
from cartoloop.sensor.pose import Pose, quick_pose

_COUNTS = ("num_turns", "num_stretches", "num_metres")


@dataclass(frozen=True, slots=True)
class OdometryParameters:
    """The estimated errors of the odometry.

    Attributes
    ----------
    time_offset : a reading is this much newer than the scan of the same stamp [s].
    rotation_scale, translation_scale : true motion over reported motion.
    yaw : forward direction of the odometry in the tracking frame [rad].
    lever_x, lever_y : the tracking frame relative to the point whose motion is reported [m].
    rotation_error : median error of the rotation of a calibrated step [rad]; NaN before the robot
        has turned enough, because straight steps do not show it.
    num_turns : number of turning steps that it was estimated from.
    translation_error : the same of the distance [m]; NaN before the first estimate.
    veer : turn on each metre that is not reported.
    num_stretches : number of metres that it was estimated from.
    scale_error : standard error of the translation scale; NaN before scans have measured it.
    metre_noise : standard deviation of a metre at that scale [m]; NaN before that, too.
    num_metres : number of metres that scans have measured.
    """

    time_offset: float = 0.0
    rotation_scale: float = 1.0
    translation_scale: float = 1.0
    yaw: float = 0.0
    lever_x: float = 0.0
    lever_y: float = 0.0
    rotation_error: float = math.nan
    translation_error: float = math.nan
    num_turns: int = 0
    veer: Veer = NO_VEER
    num_stretches: int = 0
    scale_error: float = math.nan
    metre_noise: float = math.nan
    num_metres: int = 0

    @property
    def is_known(self) -> bool:
        """Whether there was enough motion for an estimate."""
        return not math.isnan(self.translation_error)

    @property
    def knows_rotation(self) -> bool:
        """Whether the robot has turned enough for an estimate of clock offset and rotation."""
        return not math.isnan(self.rotation_error)

    @property
    def knows_scale(self) -> bool:
        """Whether scans alone have measured the translation scale."""
        return not math.isnan(self.scale_error)

    @property
    def veer_by_name(self) -> dict[str, float]:
        """The veer, for documents [rad/m]: constant, cos, sin."""
        return self.veer._asdict()

    def summary(self) -> dict[str, Any]:
        """Return the estimates, for the report."""
        return {
            "time_offset_s": self.time_offset,
            "rotation_scale": self.rotation_scale,
            "translation_scale": self.translation_scale,
            "yaw_rad": self.yaw,
            "lever_m": [self.lever_x, self.lever_y],
            "veer_rad_per_m": self.veer_by_name,
            "rotation_error_rad": self.rotation_error if self.knows_rotation else None,
            "translation_error_m": self.translation_error if self.is_known else None,
            "metre_noise_m": None if math.isnan(self.metre_noise) else self.metre_noise,
            "measured_metres": self.num_metres,
        }

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as values of JSON, None for what is not known."""
        values = {**asdict(self), "veer": list(self.veer)}
        return {
            name: None if isinstance(value, float) and math.isnan(value) else value
            for name, value in values.items()
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> OdometryParameters:
        """Return what :meth:`to_dict` made values of JSON of; what is missing is not known.

        Raises
        ------
        ValueError, TypeError, AttributeError
            They are of something else.
        """
        values: dict[str, Any] = {
            name: math.nan if value is None else float(value)
            for name, value in content.items()
            if name != "veer" and name not in _COUNTS
        }
        for name in _COUNTS:
            values[name] = int(content.get(name, 0))
        constant, cos, sin = content.get("veer", NO_VEER)
        return cls(**values, veer=Veer(float(constant), float(cos), float(sin)))

    def predict(self, reported: Pose, heading: float = 0.0) -> Pose:
        """Return the motion of the tracking frame for a motion that the odometry reports.

        Parameters
        ----------
        reported : the motion.
        heading : of the odometry at its begin [rad].
        """
        x, y, turned = self.veer.corrected(reported, heading)
        theta = self.rotation_scale * turned
        cos, sin = math.cos(theta) - 1.0, math.sin(theta)
        along = self.translation_scale * math.cos(self.yaw)
        across = self.translation_scale * math.sin(self.yaw)
        lever_x, lever_y = self.lever_x, self.lever_y
        return quick_pose(
            (
                along * x - across * y + cos * lever_x - sin * lever_y,
                across * x + along * y + sin * lever_x + cos * lever_y,
                theta,
            )
        )

    def predict_all(self, reported: FloatArray, headings: FloatArray) -> FloatArray:
        """Return :meth:`predict` of each row, shape (n, 3), equal to the last bit."""
        return self.without_veer_all(self.veer.corrected_all(reported, headings))

    def without_veer_all(self, reported: FloatArray) -> FloatArray:
        """Return the same of reported motions that are corrected for veer, shape (n, 3)."""
        theta = self.rotation_scale * reported[:, 2]
        # numpy's sine and cosine differ from the C library's in the last digit.
        cos = np.array([math.cos(angle) for angle in theta.tolist()]) - 1.0
        sin = np.array([math.sin(angle) for angle in theta.tolist()])
        along = self.translation_scale * math.cos(self.yaw)
        across = self.translation_scale * math.sin(self.yaw)
        x, y = reported[:, 0], reported[:, 1]
        return np.column_stack(
            (
                along * x - across * y + cos * self.lever_x - sin * self.lever_y,
                across * x + along * y + sin * self.lever_x + cos * self.lever_y,
                theta,
            )
        )


def step_information(model: OdometryParameters, config: PredictionConfig) -> FloatArray:
    """Return the information of a step by odometry, upper triangle, shape (6,)."""
    translation = config.unknown_translation_sigma
    if model.is_known:
        translation = max(
            config.translation_error_factor * model.translation_error,
            config.min_translation_sigma,
        )
    rotation = config.unknown_rotation_sigma
    if model.knows_rotation:
        rotation = max(
            config.rotation_error_factor * model.rotation_error, config.min_rotation_sigma
        )
    return isotropic_information(translation, rotation)
