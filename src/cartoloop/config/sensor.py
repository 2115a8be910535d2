# SPDX-License-Identifier: Apache-2.0
"""Parameters of the sensors."""

from __future__ import annotations

from pydantic import Field

from cartoloop.config.section import Section


class SensorConfig(Section):
    """Which part of a scan is used."""

    min_range: float | None = Field(None, ge=0, description="shorter returns are dropped [m]")
    max_range: float | None = Field(None, gt=0, description="longer returns become misses [m]")
    default_max_range: float = Field(
        30.0,
        gt=0,
        description="max_range where it is not set; beyond, the beams of common scanners are too "
        "sparse to help [m]",
    )
    laser_pose: tuple[float, float, float] | None = Field(
        None, description="pose of the scanner on the robot: x, y [m], yaw [rad]"
    )
    sweep_s: float | None = Field(
        None,
        gt=0,
        le=1,
        description="time from the first beam to the last of scans that do not state it, as those "
        "of CARMEN logs: 0.0067 of a SICK LMS at 1 degree, 0.067 of a Hokuyo URG-04LX; otherwise "
        "all beams count as measured at once [s]",
    )
    upside_down: bool = Field(
        False,
        description="mirror the beams: the scanner is mounted upside down, or sends them in the "
        "other order, and the recording does not say so",
    )
    missing_data_ray_length: float = Field(
        5.0, ge=0, description="free space cleared along a beam without a return [m]"
    )
    missing_data_agreement_deg: float = Field(
        1.0,
        ge=0,
        description="but only if the beams up to this angle on each side, at least one, have no "
        "return or a range of that length too: dark and slanting surfaces return nothing; 0: "
        "whatever they measure [deg]",
    )
    smooth_walls: bool = Field(
        True,
        description="average the ranges of dense scans along walls: of beams up to 0.4 degrees "
        "apart, with a noise of 7 mm or more",
    )
    min_z: float = Field(
        -0.8,
        description="lower points of tilted scans and clouds are floor; height above the "
        "tracking frame [m]",
    )
    max_z: float = Field(2.0, description="higher points are ceiling [m]")
    cloud_directions: int = Field(
        720, ge=8, description="directions into which a point cloud is divided, one return each"
    )
    cloud_below: float = Field(
        0.3,
        ge=0,
        description="points of a cloud further below its scanner are dropped where its source "
        "sets no height limits: floor [m]",
    )
    cloud_above: float = Field(0.7, ge=0, description="and points further above it [m]")
    voxel_filter_size: float = Field(
        0.025,
        gt=0,
        description="cell edge of the fixed voxel filter, which keeps one point each [m]",
    )
