# SPDX-License-Identifier: Apache-2.0
"""Every parameter on one page: default, unit, meaning. Keys are Cartographer's where it has them.

One configuration serves all recordings. What depends on the sensor (field of view, range limits,
rate) is read off the recording by the sensor profile; ``None`` here means "as profiled".
"""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Section(BaseModel):
    """A group of parameters: no unknown keys, no change after it is made."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


class SensorConfig(Section):
    """What of a scan is used."""

    min_range: float | None = Field(None, ge=0, description="shorter returns are dropped [m]")
    max_range: float | None = Field(None, gt=0, description="longer returns become misses [m]")
    missing_data_ray_length: float = Field(
        5.0, ge=0, description="free space cleared along a beam without a return [m]"
    )
    voxel_filter_size: float = Field(
        0.025, gt=0, description="edge of the fixed filter's cells: one point in each [m]"
    )


class AdaptiveVoxelFilterConfig(Section):
    """The coarsest voxel filter that keeps enough points."""

    max_length: float = Field(0.5, gt=0, description="largest cell edge tried [m]")
    min_num_points: int = Field(200, ge=1, description="points that must remain")
    max_range: float = Field(50.0, gt=0, description="points further away are not used [m]")


class CorrelativeMatcherConfig(Section):
    """The pixel-accurate matcher for poor predictions."""

    linear_search_window: float = Field(0.15, ge=0, description="search this far to each side [m]")
    angular_search_window_deg: float = Field(20.0, ge=0, description="and so much each way [deg]")
    translation_delta_cost_weight: float = Field(
        0.1, ge=0, description="damping of the score with distance from the prediction [1/m^2]"
    )
    rotation_delta_cost_weight: float = Field(
        0.1, ge=0, description="damping of the score with rotation from the prediction [1/rad^2]"
    )


class LeastSquaresMatcherConfig(Section):
    """The weights of (CS), section IV-C, and of its pulls towards the prediction."""

    occupied_space_weight: float = Field(10.0, gt=0, description="pull of the map")
    translation_weight: float = Field(1.0, ge=0, description="pull of the predicted position [1/m]")
    rotation_weight: float = Field(4.0, ge=0, description="pull of the predicted heading [1/rad]")
    max_num_iterations: int = Field(20, ge=1, description="steps at the most")


class MotionFilterConfig(Section):
    """A scan is inserted only when one of these is exceeded since the last one inserted."""

    max_time_seconds: float = Field(5.0, ge=0, description="time [s]")
    max_distance_meters: float = Field(0.2, ge=0, description="distance [m]")
    max_angle_degrees: float = Field(1.0, ge=0, description="rotation [deg]")


class SubmapConfig(Section):
    """Probability grids, section IV-B."""

    resolution: float = Field(0.05, gt=0, description="edge of a pixel, r [m]")
    num_range_data: int = Field(
        45, ge=1, description="scans until the next submap starts; each receives twice as many"
    )
    hit_probability: float = Field(0.6, gt=0.5, lt=1, description="p_hit of eq. (3)")
    miss_probability: float = Field(0.45, gt=0, lt=0.5, description="p_miss of eq. (3)")


class LocalSlamConfig(Section):
    """Section IV: scans to poses in the local frame."""

    use_odometry: bool = Field(True, description="predict with wheel odometry where there is any")
    adaptive_voxel_filter: AdaptiveVoxelFilterConfig = AdaptiveVoxelFilterConfig()
    correlative_matcher: CorrelativeMatcherConfig = CorrelativeMatcherConfig()
    least_squares_matcher: LeastSquaresMatcherConfig = LeastSquaresMatcherConfig()
    motion_filter: MotionFilterConfig = MotionFilterConfig()
    submaps: SubmapConfig = SubmapConfig()


class ConstraintSearchConfig(Section):
    """Section V-B: which pairs of scan and finished submap are searched, and what is accepted."""

    max_constraint_distance: float = Field(
        15.0, ge=0, description="pairs further apart are not searched [m]"
    )
    linear_search_window: float = Field(7.0, ge=0, description="W_x and W_y of eq. (8) [m]")
    angular_search_window_deg: float = Field(30.0, ge=0, description="W_theta of eq. (8) [deg]")
    min_score: float = Field(0.55, ge=0, le=1, description="matches below are rejected")
    adaptive_voxel_filter: AdaptiveVoxelFilterConfig = AdaptiveVoxelFilterConfig(
        max_length=0.9, min_num_points=100
    )
    least_squares_matcher: LeastSquaresMatcherConfig = LeastSquaresMatcherConfig(
        occupied_space_weight=20.0, translation_weight=10.0, rotation_weight=1.0, max_num_iterations=10
    )


class PoseAdjustmentConfig(Section):
    """Section V-A: the optimisation problem (SPA)."""

    loss: Literal["none", "huber", "cauchy", "dcs", "gnc"] = Field(
        "huber", description="loss of loop closures: rho of (SPA)"
    )
    loss_scale: float = Field(1.0, gt=0, description="whitened residual where the loss bends")
    max_num_iterations: int = Field(50, ge=1, description="steps at the most, while mapping")
    max_num_final_iterations: int = Field(200, ge=1, description="steps at the most, in the end")
    tolerance: float = Field(1e-6, gt=0, description="relative decrease of the cost that ends it")


class GlobalSlamConfig(Section):
    """Section V: closing loops."""

    optimize_every_n_nodes: int = Field(
        90, ge=0, description="nodes between two adjustments; 0 switches loop closure off"
    )
    constraint_search: ConstraintSearchConfig = ConstraintSearchConfig()
    pose_adjustment: PoseAdjustmentConfig = PoseAdjustmentConfig()
    num_threads: int = Field(
        0, ge=0, description="background threads of the search; 0: as many as processors, at most 4"
    )


class MapOutputConfig(Section):
    """The exported map."""

    occupied_thresh: float = Field(0.65, gt=0, lt=1, description="occupied above, in map.yaml")
    free_thresh: float = Field(0.196, gt=0, lt=1, description="free below, in map.yaml")


class Config(Section):
    """All parameters."""

    sensor: SensorConfig = SensorConfig()
    local_slam: LocalSlamConfig = LocalSlamConfig()
    global_slam: GlobalSlamConfig = GlobalSlamConfig()
    map_output: MapOutputConfig = MapOutputConfig()
