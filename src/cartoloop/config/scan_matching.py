# SPDX-License-Identifier: Apache-2.0
"""Parameters of scan matching, which local and global SLAM share."""

from __future__ import annotations

from pydantic import Field

from cartoloop.config.section import Section


class AdaptiveVoxelFilterConfig(Section):
    """The coarsest voxel filter that keeps enough points."""

    max_length: float = Field(0.5, gt=0, description="largest cell edge tried [m]")
    min_num_points: int = Field(200, ge=1, description="points that must remain")
    max_range: float = Field(50.0, gt=0, description="points further away are not used [m]")


class CorrelativeMatcherConfig(Section):
    """The exhaustive pixel-accurate matcher, used where the prediction is poor."""

    linear_search_window: float = Field(0.15, ge=0, description="search window radius [m]")
    angular_search_window_deg: float = Field(20.0, ge=0, description="search window radius [deg]")
    translation_delta_cost_weight: float = Field(
        0.1, ge=0, description="damping of the score with distance from the prediction [1/m]"
    )
    rotation_delta_cost_weight: float = Field(
        0.1, ge=0, description="damping of the score with rotation from the prediction [1/rad]"
    )
    max_rotation_step_range: float = Field(
        10.0, gt=0, description="points farther away do not make the rotation step finer [m]"
    )
    initial_residual: float = Field(
        0.5, gt=0, description="typical residual of a match, assumed before the first match"
    )
    residual_memory: float = Field(
        0.02, gt=0, le=1, description="weight of a new match in the typical residual"
    )
    poor_residual_ratio: float = Field(
        1.2,
        ge=0,
        description="residual over typical residual above which a scan is matched again with this "
        "matcher; 0: always",
    )
    lost_residual_ratio: float = Field(
        1.3, ge=0, description="residual over typical residual above which the robot may be lost"
    )
    min_seen_share: float = Field(
        0.25,
        ge=0,
        le=1,
        description="share of a scan's points in observed cells below which it does not contradict "
        "the odometry",
    )
    ample_seen_share: float = Field(
        0.6,
        ge=0,
        le=1,
        description="share of a scan's points in observed cells from which a better match nearby "
        "may turn it by some degrees, and a match at any heading counts if it is lost",
    )
    min_num_seen: int = Field(20, ge=1, description="and number of these points")
    lost_improvement: float = Field(
        0.85, gt=0, le=1, description="residual ratio by which a match elsewhere must be better"
    )
    lost_prior_weight: float = Field(
        0.4,
        ge=0,
        description="weight of the motion prior by odometry that such a match must outweigh",
    )
    lost_linear_search_window: float = Field(
        0.3, ge=0, description="search window radius when lost [m]"
    )
    lost_angular_search_window_deg: float = Field(
        60.0, ge=0, description="search window radius when lost [deg]"
    )
    max_lost_scans: int = Field(
        5,
        ge=1,
        description="number of scans in turn that do not fit, at most, which weigh together "
        "against odometry",
    )


class LeastSquaresMatcherConfig(Section):
    """The least-squares matcher (CS), section IV-C."""

    occupied_space_weight: float = Field(
        0.3,
        gt=0,
        description="weight of the points' information, below 1 because the errors of neighbouring "
        "points are correlated",
    )
    max_num_iterations: int = Field(20, ge=1, description="maximum number of iterations")
    tolerance: float = Field(
        1e-5, gt=0, description="relative decrease of the cost below which the iteration ends"
    )
