# SPDX-License-Identifier: Apache-2.0
"""Every parameter on one page: default, unit, meaning. Keys are Cartographer's where it has them.

One configuration serves all recordings. What depends on the sensor (field of view, range limits,
rate) is read off the recording by the sensor profile; ``None`` here means "as profiled".
"""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cartoloop.errors import ConfigError
from cartoloop.kernels.pose_adjustment.losses import Loss


class Section(BaseModel):
    """A group of parameters: no unknown keys, no change after it is made."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, validate_default=True, allow_inf_nan=False
    )

    def __init__(self, /, *others: object, **values: Any) -> None:  # noqa: ANN401
        """Set the parameters that are given; the others have their defaults.

        Raises
        ------
        ConfigError
            A parameter is unknown, or its value impossible.
        """
        name = type(self).__name__
        if others:
            raise ConfigError(f"{name}: name each parameter, like {name}(sensor={{...}})")
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise ConfigError(f"{name}: {_first_fault(error, type(self))}") from None

    # A section within another is checked as a part of it, not by itself, as with pydantic's own.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def __setattr__(self, name: str, value: object) -> None:
        raise ConfigError(
            f"{type(self).__name__}.{name}: a configuration does not change once it is made; make "
            "another, by cartoloop.Config(...) or model_copy(update={...})"
        )


def _first_fault(error: ValidationError, section: type[BaseModel]) -> str:
    """Return the first fault of values for a section in one line."""
    fault = error.errors()[0]
    *sections, leaf = map(str, fault["loc"])
    for part in sections:
        field = section.model_fields.get(part)
        if field is None or not isinstance(field.annotation, type):
            break
        section = field.annotation
    key = ".".join((*sections, leaf))
    if fault["type"] == "extra_forbidden":
        nearest = get_close_matches(leaf, section.model_fields, n=1, cutoff=0.5)
        hint = f"did you mean {nearest[0]}?" if nearest else "'cartoloop config show' lists all"
        return f"unknown parameter {key}; {hint}"
    message = fault["msg"].removeprefix("Value error, ")
    return f"{key} is {' '.join(repr(fault['input']).split())[:40]}: {message}"


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
        1.05,
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
        "always corrects the odometry",
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


class PredictionConfig(Section):
    """The motion prior of a scan: standard deviations of its predicted pose."""

    translation_error_factor: float = Field(
        2.0, gt=0, description="sigma of the odometry's distance over its measured typical error"
    )
    rotation_error_factor: float = Field(
        4.0, gt=0, description="sigma of the odometry's rotation over its measured typical error"
    )
    failure_scale: float = Field(
        4.0, gt=0, description="scale of the Cauchy loss on the motion prior [standard deviations]"
    )
    spurious_information: float = Field(
        0.25,
        ge=0,
        le=1,
        description="share of a scan's information across a corridor that noise adds along it",
    )
    min_translation_sigma: float = Field(
        0.01, gt=0, description="lower limit of the odometry's sigma [m]"
    )
    min_rotation_sigma: float = Field(
        0.005, gt=0, description="lower limit of the odometry's sigma [rad]"
    )
    unknown_translation_sigma: float = Field(
        0.02, gt=0, description="sigma of odometry that is not yet calibrated [m]"
    )
    unknown_rotation_sigma: float = Field(
        0.1, gt=0, description="sigma of odometry that is not yet calibrated [rad]"
    )
    acceleration: float = Field(
        1.0, gt=0, description="without odometry: typical change of the velocity [m/s^2]"
    )
    angular_acceleration: float = Field(
        10.0, gt=0, description="typical change of the angular velocity [rad/s^2]"
    )
    velocity_horizon: float = Field(
        1.0, gt=0, description="longest time over which the velocity is extrapolated [s]"
    )
    matched_translation_sigma: float = Field(
        0.015, gt=0, description="error of a matched step: some tenths of a pixel [m]"
    )
    matched_rotation_sigma: float = Field(0.003, gt=0, description="error of a matched step [rad]")
    gyro_turn_sigma: float = Field(
        0.005, gt=0, description="error of a gyroscope's turn between two scans [rad]"
    )
    gyro_rate_sigma: float = Field(
        0.02, gt=0, description="its growth with time, bias and scale together [rad/s]"
    )
    pixel_noise: float = Field(
        0.5,
        gt=0,
        description="error of a match along a direction that only pixel noise determines [pixels]",
    )
    slow_step: float = Field(
        1.0,
        ge=0,
        description="without odometry: a shorter predicted step gets a weak prior, because "
        "quantization to pixels already favours standing still [pixels]",
    )
    lost_translation_sigma: float = Field(
        0.2, gt=0, description="upper limit of the sigma without odometry, and sigma when lost [m]"
    )
    lost_rotation_sigma: float = Field(
        0.2,
        gt=0,
        description="upper limit of the sigma without odometry, and sigma when lost [rad]",
    )


class WallStepConfig(Section):
    """The step along bare walls, from one scan to the next: without odometry, or against it."""

    max_ratio: float = Field(
        0.7,
        ge=0,
        le=1,
        description="lines across over lines along the walls of a scan, below which the step is "
        "examined; 0: never",
    )
    max_speed: float = Field(2.0, gt=0, description="of the robot [m/s]")
    max_step: float = Field(1.0, gt=0, description="longest step that is tried [m]")
    step: float = Field(0.02, gt=0, description="distance between steps that are tried [m]")
    sigma: float = Field(0.02, gt=0, description="of the distance of a return from a wall [m]")
    max_distance: float = Field(0.1, gt=0, description="beyond, a return fits as badly as any [m]")
    outside_cost: float = Field(
        0.3, ge=0, description="share of that cost of returns where the last scan shows nothing"
    )
    min_evidence: float = Field(
        20.0, gt=0, description="half of the chi square by which a step must fit better"
    )
    evidence_memory: float = Field(
        0.8, ge=0, lt=1, description="share of the evidence that the next scan keeps"
    )
    evidence_of_noise: float = Field(
        8.0, ge=0, description="is subtracted from the evidence for a step next to the matched one"
    )
    min_rise: float = Field(
        5.0, ge=0, description="and by which steps that are max_distance away must fit worse"
    )
    max_turn_deg: float = Field(
        4.0, ge=0, description="scans are not compared across larger turns [deg]"
    )
    min_num_returns: int = Field(50, ge=2, description="scans with fewer are not compared")
    max_gap_deg: float = Field(3.0, gt=0, description="between neighbouring returns [deg]")
    position_sigma: float = Field(0.02, gt=0, description="of the step that was found [m]")
    min_odometry_evidence: float = Field(
        40.0, gt=0, description="with odometry: the same as min_evidence"
    )
    min_odometry_step: float = Field(
        0.15, ge=0, description="with odometry: scans are compared over at least this distance [m]"
    )
    max_odometry_step: float = Field(
        0.6,
        gt=0,
        description="and over at most this distance, since scans further apart overlap "
        "too little to contradict wheels [m]",
    )
    max_odometry_duration: float = Field(
        0.3, gt=0, description="or after this time, since wheels may not turn while it moves [s]"
    )
    max_standstill: float = Field(
        3.0,
        ge=0,
        description="odometry that has not moved at all for less than this is left alone: it may "
        "repeat a reading, and catch up [s]",
    )
    min_odometry_error: float = Field(
        0.06, ge=0, description="smaller errors of its step are left to the odometry [m]"
    )
    odometry_cost_ratio: float = Field(
        3.0,
        ge=1,
        description="and its step must fit worse than another by this factor, unless that fits "
        "closely",
    )
    close_fit: float = Field(
        0.25,
        ge=0,
        description="half of the chi square for each return up to which a step fits closely",
    )


class DeskewingConfig(Section):
    """Motion during the sweep of a scanner."""

    motion_step: float = Field(
        0.01, gt=0, description="time step at which the motion is sampled: walking hardly turns [s]"
    )
    min_translation_correction: float = Field(
        0.005,
        ge=0,
        description="change of the motion by a match above which a sweep is deskewed again [m]",
    )
    min_rotation_correction: float = Field(0.002, ge=0, description="or by more than this [rad]")


class MotionFilterConfig(Section):
    """A scan is inserted only when one of these is exceeded since the last one inserted."""

    max_time_seconds: float = Field(5.0, ge=0, description="time [s]")
    max_distance_meters: float = Field(0.2, ge=0, description="distance [m]")
    max_angle_degrees: float = Field(1.0, ge=0, description="rotation [deg]")


class SubmapConfig(Section):
    """Probability grids, section IV-B."""

    resolution: float = Field(0.05, gt=0, description="edge of a pixel, r [m]")
    num_range_data: int = Field(
        90, ge=1, description="scans until the next submap starts; each receives twice as many"
    )
    max_travel: float = Field(
        25.0,
        gt=0,
        description="distance after which the next submap starts even if scans are sparse, to "
        "limit drift [m]",
    )
    hit_probability: float = Field(0.6, gt=0.5, lt=1, description="p_hit of eq. (3)")
    miss_probability: float = Field(0.45, gt=0, lt=0.5, description="p_miss of eq. (3)")


class InsertionConfig(Section):
    """Which scans are inserted without a match, and the information of their poses."""

    min_num_points: int = Field(
        10, ge=1, description="a scan with fewer points is not matched: its pose is the prediction"
    )
    first_translation_information: float = Field(
        1e4, gt=0, description="of the first scan, whose pose defines its submap [1/m^2]"
    )
    first_rotation_information: float = Field(1e5, gt=0, description="of the first scan [1/rad^2]")
    predicted_translation_information: float = Field(
        400.0, gt=0, description="of the first scan of a further scanner [1/m^2]"
    )
    predicted_rotation_information: float = Field(
        2500.0, gt=0, description="of the first scan of a further scanner [1/rad^2]"
    )


class LocalSlamConfig(Section):
    """Section IV: scans to poses in the local frame."""

    use_odometry: bool = Field(True, description="predict with wheel odometry where there is any")
    use_imu: bool = Field(True, description="use heading and gravity of an IMU where there is one")
    imu_gravity_time_constant: float = Field(
        10.0, gt=0, description="time over which the acceleration is averaged to find gravity [s]"
    )
    project_to_horizontal: bool = Field(
        True, description="project scans onto the horizontal plane where an IMU measures gravity"
    )
    adaptive_voxel_filter: AdaptiveVoxelFilterConfig = AdaptiveVoxelFilterConfig()
    correlative_matcher: CorrelativeMatcherConfig = CorrelativeMatcherConfig()
    least_squares_matcher: LeastSquaresMatcherConfig = LeastSquaresMatcherConfig()
    prediction: PredictionConfig = PredictionConfig()
    wall_step: WallStepConfig = WallStepConfig()
    deskewing: DeskewingConfig = DeskewingConfig()
    motion_filter: MotionFilterConfig = MotionFilterConfig()
    insertion: InsertionConfig = InsertionConfig()
    submaps: SubmapConfig = SubmapConfig()


class WideSearchConfig(Section):
    """Loop closures where the drift is large: composite scans, searched in all submaps in reach.

    What is found is a hypothesis. It becomes a closure when others along the way agree with it.
    """

    min_path_length: float = Field(
        100.0, ge=0, description="pairs with a longer path between them are searched this way [m]"
    )
    rotation_drift_deg: float = Field(
        0.3,
        gt=0,
        description="standard deviation of the heading after a metre of path; it grows "
        "with the root of the length [deg/sqrt(m)]",
    )
    translation_drift: float = Field(
        0.1,
        gt=0,
        description="the same of the position, beside what the heading causes [m/sqrt(m)]",
    )
    num_sigmas: float = Field(
        3.0, gt=0, description="radius of the search window in standard deviations of the drift"
    )
    spacing: float = Field(
        4.0, gt=0, description="path length from one composite scan to the next [m]"
    )
    length: float = Field(
        3.0, ge=0, description="path length that the scans of a composite scan come from [m]"
    )
    max_num_scans: int = Field(20, ge=1, description="scans in a composite scan, at most")
    adaptive_voxel_filter: AdaptiveVoxelFilterConfig = AdaptiveVoxelFilterConfig(
        max_length=0.9, min_num_points=200, max_range=30.0
    )
    max_submaps: int = Field(
        60, ge=1, description="a composite scan is searched in this many submaps, the likeliest"
    )
    min_score: float = Field(0.45, ge=0, le=1, description="matches below are rejected")
    min_score_ratio: float = Field(
        0.82, ge=0, le=1, description="or below this share of the score of the submap's own scans"
    )
    place_distance: float = Field(
        1.0, gt=0, description="two matches farther apart are in different places [m]"
    )
    place_angle_deg: float = Field(
        10.0, gt=0, description="or turned by more against each other [deg]"
    )
    min_margin: float = Field(
        0.03, ge=0, description="the score must exceed that in any other place by this"
    )
    max_span: float = Field(
        80.0, gt=0, description="hypotheses that support each other lie within this path length [m]"
    )
    max_disagreement: float = Field(
        0.3, ge=0, description="two hypotheses agree if the path between them fits to this [m]"
    )
    max_disagreement_growth: float = Field(
        0.03, ge=0, description="and to this for each metre between them [m/m]"
    )
    max_turn_deg: float = Field(2.0, ge=0, description="the same for the heading [deg]")
    max_turn_growth_deg: float = Field(
        0.1, ge=0, description="and for each metre between them [deg/m]"
    )
    min_hypotheses: int = Field(
        2, ge=1, description="hypotheses that must agree before they become closures"
    )
    min_evidence: float = Field(
        0.12,
        ge=0,
        description="by which their scores together must exceed threshold and other places",
    )
    max_strain: float = Field(
        1.0,
        gt=0,
        description="closures of this search are trusted until the map contradicts them "
        "by more than this [m]",
    )
    max_strain_deg: float = Field(5.0, gt=0, description="or by more than this [deg]")
    max_final_rounds: int = Field(
        4, ge=0, description="searches of all that is due at the end, while they find something new"
    )


class JoinConfig(Section):
    """Parts of a map whose relative pose is not known, such as sessions of other days.

    Composite scans of one part are searched in all submaps of the others, at all angles.
    """

    min_score: float = Field(
        0.42,
        ge=0,
        le=1,
        description="matches below are rejected; where parts overlap a little, they score low",
    )
    min_score_ratio: float = Field(
        0.75, ge=0, le=1, description="or below this share of the score of the submap's own scans"
    )
    min_margin: float = Field(
        0.03, ge=0, description="the score must exceed that in any other place by this"
    )
    min_hypotheses: int = Field(
        3, ge=1, description="composite scans that must agree before two parts are joined"
    )
    min_evidence: float = Field(
        0.25, ge=0, description="by which their scores must exceed threshold and other places"
    )
    min_extent: float = Field(
        4.0, ge=0, description="largest distance between two scans that agree, at least [m]"
    )
    max_rival_share: float = Field(
        0.5,
        gt=0,
        description="scans that agree on another place have at most this share of the evidence",
    )
    min_overlap: float = Field(
        3.0, ge=0, description="path along which the parts must overlap to be compared [m]"
    )
    max_contradicted_share: float = Field(
        0.1, gt=0, le=1, description="share of that path whose scans may contradict the other part"
    )
    max_floor_share: float = Field(
        0.1, gt=0, le=1, description="share of returns that may lie on floor of the other part"
    )
    max_contradicted_wall: float = Field(
        1.2,
        ge=0,
        description="length of a wall of the one part on floor of the other, from which it "
        "forbids the join [m]; doors and furniture are shorter",
    )
    min_hidden_area: float = Field(
        3.0,
        ge=0,
        description="if the other part saw at least this much behind it [m^2]: behind furniture "
        "there is less",
    )
    known_pose_window: float = Field(
        3.0, ge=0, description="search window radius where the pose in the map is given [m]"
    )
    known_pose_window_deg: float = Field(
        30.0, ge=0, description="and its angle, to each side [deg]"
    )
    max_searches: int = Field(
        40_000, ge=0, description="composite scans searched in submaps of other parts, at most"
    )


class ConstraintSearchConfig(Section):
    """Section V-B: which pairs of scan and finished submap are searched, and what is accepted."""

    max_constraint_distance: float = Field(
        15.0, ge=0, description="pairs further apart are not searched [m]"
    )
    linear_search_window: float = Field(7.0, ge=0, description="W_x and W_y of eq. (8) [m]")
    angular_search_window_deg: float = Field(30.0, ge=0, description="W_theta of eq. (8) [deg]")
    min_linear_search_window: float = Field(
        0.5, ge=0, description="W_x and W_y where the relative pose is well known [m]"
    )
    min_angular_search_window_deg: float = Field(
        5.0, ge=0, description="W_theta where the relative pose is well known [deg]"
    )
    linear_drift: float = Field(
        0.05, ge=0, description="growth of W_x and W_y per metre of path between the two [m/m]"
    )
    angular_drift_deg: float = Field(
        0.5, ge=0, description="growth of W_theta per metre of path between the two [deg/m]"
    )
    closure_path_length: float = Field(
        0.5, ge=0, description="a loop closure is as uncertain as this length of the path [m]"
    )
    well_constrained_length: float = Field(
        30.0, ge=0, description="pairs with a shorter path between them are well constrained [m]"
    )
    every_nth_node: int = Field(
        2, ge=1, description="of other pairs, one node in n is searched in a submap"
    )
    every_nth_well_constrained_node: int = Field(
        10, ge=1, description="of well constrained pairs, one node in n"
    )
    max_searches_of_well_constrained_pair: int = Field(
        5, ge=0, description="nodes of one submap searched in another, if well constrained"
    )
    max_closures_of_pair: int = Field(
        12, ge=1, description="closures between two submaps after which searches between them end"
    )
    search_batch_size: int = Field(
        50, ge=1, description="nodes that one task of a background thread searches in a submap"
    )
    search_stride: int = Field(
        4, ge=1, description="a task searches every n-th of its nodes first, spread on the path"
    )
    min_search_batch: int = Field(
        12, ge=1, description="searches in a submap are deferred until there are this many"
    )
    max_search_deferrals: int = Field(2, ge=0, description="but not more often than this")
    min_num_points: int = Field(20, ge=1, description="scans with fewer points are not searched")
    min_score: float = Field(0.55, ge=0, le=1, description="matches below are rejected")
    min_score_ratio: float = Field(
        0.85, ge=0, le=1, description="or below this share of the score of the submap's own scans"
    )
    min_runner_up_margin: float = Field(
        0.05,
        ge=0,
        description="matches that another place in the window fits as well, to this score, are "
        "rejected as ambiguous",
    )
    adaptive_voxel_filter: AdaptiveVoxelFilterConfig = AdaptiveVoxelFilterConfig(
        max_length=0.9, min_num_points=100
    )
    least_squares_matcher: LeastSquaresMatcherConfig = LeastSquaresMatcherConfig()
    refinement_sigma_cells: float = Field(
        2.0, gt=0, description="sigma of the refinement's prior at the coarse match [pixels]"
    )
    usual_residual: float = Field(
        0.4, gt=0, description="root mean square of 1 - M at the returns of scans that fit"
    )
    lever: float = Field(
        5.0, gt=0, description="typical range of returns: from position to heading error [m]"
    )
    final_passes: int = Field(
        2, ge=0, description="number of passes at the end that match again from adjusted poses"
    )
    final_every_nth_node: int = Field(
        2, ge=1, description="at the end, one in n nodes that overlap a submap is matched"
    )
    final_max_submaps_of_node: int = Field(
        32, ge=1, description="at the end, a node is matched to this many nearest submaps at most"
    )
    max_start_residual: float = Field(
        0.75, gt=0, description="at the end, scans with a larger residual are not matched"
    )
    max_refined_residual: float = Field(
        0.55, gt=0, description="at the end, matches with a larger residual are rejected"
    )
    max_refinement: float = Field(
        0.3,
        gt=0,
        description="at the end, matches farther from the adjusted pose are rejected [m]",
    )
    wide_search: WideSearchConfig = WideSearchConfig()
    join: JoinConfig = JoinConfig()


class PoseAdjustmentConfig(Section):
    """Section V-A: the optimisation problem (SPA)."""

    loss: Loss = Field(Loss.HUBER, description="robust loss of loop closures: rho of (SPA)")
    loss_scale: float | None = Field(
        None,
        gt=0,
        description="residual E beyond which a closure's influence is limited; unless set, the "
        "default of the loss: 3, or 6 for graduated_non_convexity",
    )
    intra_submap_weight: float = Field(
        0.7,
        gt=0,
        description="share of the information of scan matches that is used: submaps are distorted",
    )
    max_num_iterations: int = Field(50, ge=1, description="steps at most, while mapping")
    max_num_final_iterations: int = Field(200, ge=1, description="steps at most, in the end")
    tolerance: float = Field(1e-6, gt=0, description="relative decrease of the cost that ends it")


class GlobalSlamConfig(Section):
    """Section V: closing loops."""

    optimize_every_n_nodes: int = Field(
        90, ge=0, description="nodes between two adjustments; 0 switches loop closure off"
    )
    searches_per_adjustment: int = Field(
        2, ge=1, description="how often searches are started from one adjustment to the next"
    )
    live_searches_per_adjustment: int = Field(
        9, ge=1, description="the same in live mapping; what is found joins the graph as often"
    )
    max_live_backlog: int = Field(
        10_000, ge=0, description="searches that wait in live mapping, at most; some seconds' work"
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


class QualityConfig(Section):
    """The examination of the finished map, and when it is called doubtful or wrong."""

    enabled: bool = Field(True, description="examine the finished map")
    every_nth_node: int = Field(
        6, ge=1, description="one node in n is compared with each submap nearby"
    )
    nearby: float = Field(
        5.0,
        gt=0,
        description="nodes farther from the path of a submap are not compared with it [m]",
    )
    max_range: float = Field(10.0, gt=0, description="returns farther away are not compared [m]")
    min_visit_path: float = Field(
        8.0,
        ge=0,
        description="path between two visits of a place; compared over less, scans must fit as "
        "consecutive ones do [m]",
    )
    max_displacement: float = Field(
        1.0, gt=0, description="displacement up to which a better fit is searched for [m]"
    )
    max_searches: int = Field(100, ge=0, description="searches for displacements, at most")
    min_consecutive_pairs: int = Field(
        5, ge=1, description="with fewer comparisons of consecutive scans none of them counts"
    )
    consecutive_contradiction: float = Field(
        0.3,
        gt=0,
        le=1,
        description="share of returns on floor from which consecutive scans do "
        "not fit to each other",
    )
    doubtful_blind_length: float = Field(
        5.0, gt=0, description="path without a match from which the map is doubtful [m]"
    )
    doubtful_length_error: float = Field(
        0.45,
        gt=0,
        description="expected error of a corridor's length from which the map is doubtful [m]",
    )
    doubtful_open_error: float = Field(
        5.0,
        gt=0,
        description="expected error at an end of the path that no other visit confirms, "
        "from which the map is doubtful [m]",
    )
    doubtful_share: float = Field(
        0.08,
        gt=0,
        le=1,
        description="share of the revisited path that contradicts itself from "
        "which the map is doubtful",
    )
    wrong_share: float = Field(0.15, gt=0, le=1, description="the share from which it is wrong")
    doubtful_break_share: float = Field(
        0.2,
        gt=0,
        le=1,
        description="share of consecutive scans that do not fit to each other "
        "from which the map is doubtful",
    )


class LifelongConfig(Section):
    """Maps of a place that is seen again and again: old submaps give way to newer ones."""

    enabled: bool = Field(
        False, description="remove what later sessions cover, and fade what they contradict"
    )
    min_covered_share: float = Field(
        0.8,
        gt=0,
        le=1,
        description="a submap is removed if later sessions have seen this share of its cells",
    )
    max_lost_wall: float = Field(
        0.5,
        ge=0,
        description="and if at most so much wall lies outside the grids of later submaps, where it "
        "cannot be copied to [m]",
    )
    min_certainty: float = Field(
        0.7,
        gt=0.5,
        lt=1,
        description="probability that a cell is free, or a wall, from which older evidence to "
        "the contrary fades",
    )
    memory: float = Field(
        0.8,
        gt=0,
        le=1,
        description="share of the information of removed constraints that their replacements "
        "keep: errors of matches at one place are alike",
    )


class Config(Section):
    """All parameters."""

    sensor: SensorConfig = SensorConfig()
    local_slam: LocalSlamConfig = LocalSlamConfig()
    global_slam: GlobalSlamConfig = GlobalSlamConfig()
    map_output: MapOutputConfig = MapOutputConfig()
    quality: QualityConfig = QualityConfig()
    lifelong: LifelongConfig = LifelongConfig()
