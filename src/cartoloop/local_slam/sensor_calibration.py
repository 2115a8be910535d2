# SPDX-License-Identifier: Apache-2.0
"""What local SLAM has found out about the sensors, to begin another run with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from cartoloop.local_slam.odometry_parameters import OdometryParameters


class SensorCalibration(NamedTuple):
    """What local SLAM has found out about the sensors.

    Attributes
    ----------
    odometry : clock offset, scales and errors of the odometry.
    scanner_offsets : by name: scans show the robot this much later than those of the first scanner
        with the same stamps [s]; 0 for the first.
    odometry_score : the largest score against the odometry's predictions so far.
    odometry_held_s : how long the odometry's readings are held [s]; 0 if they are not.
    odometry_is_mirrored : whether the odometry turns to the other side than the scans.
    """

    odometry: OdometryParameters
    scanner_offsets: Mapping[str, float]
    odometry_score: float = 0.0
    odometry_held_s: float = 0.0
    odometry_is_mirrored: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Return it as values of JSON, None for what is not known."""
        return {
            "odometry": self.odometry.to_dict(),
            "scanner_offsets": dict(self.scanner_offsets),
            "odometry_score": self.odometry_score,
            "odometry_held_s": self.odometry_held_s,
            "odometry_is_mirrored": self.odometry_is_mirrored,
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> SensorCalibration:
        """Return what :meth:`to_dict` made values of JSON of.

        Raises
        ------
        ValueError, TypeError, AttributeError
            They are of something else.
        """
        offsets = content.get("scanner_offsets", {})
        return cls(
            OdometryParameters.from_dict(content.get("odometry", {})),
            {str(name): float(offset) for name, offset in offsets.items()},
            float(content.get("odometry_score", 0.0)),
            float(content.get("odometry_held_s", 0.0)),
            bool(content.get("odometry_is_mirrored", False)),
        )
