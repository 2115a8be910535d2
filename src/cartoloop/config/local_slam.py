# SPDX-License-Identifier: Apache-2.0
"""Parameters of local SLAM (section IV)."""

from __future__ import annotations

from pydantic import Field

from cartoloop.config.scan_matching import (
    AdaptiveVoxelFilterConfig,
    CorrelativeMatcherConfig,
    LeastSquaresMatcherConfig,
)
from cartoloop.config.section import Section


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
        0.02,
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
    num_young_scans: int = Field(
        10,
        ge=0,
        description="first scans of a session from which a grid of walls is made: a robot without "
        "odometry is matched to that, since the pixels of few scans hold it",
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
    max_match_ratio: float = Field(
        0.05,
        ge=0,
        le=1,
        description="with odometry: ratio of the curvatures of a match, along the walls over "
        "across them, below which it may follow wheels that slip; 1: always examined",
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
    max_duration: float = Field(
        1.0,
        gt=0,
        description="without odometry: a scan is compared with later ones for this time, as long "
        "as the robot has moved by less than min_odometry_step [s]",
    )
    min_num_returns: int = Field(50, ge=2, description="scans with fewer are not compared")
    max_gap_deg: float = Field(3.0, gt=0, description="between neighbouring returns [deg]")
    position_sigma: float = Field(0.02, gt=0, description="of the step that was found [m]")
    min_odometry_evidence: float = Field(
        40.0, gt=0, description="with odometry: the same as min_evidence"
    )
    noise_factor: float = Field(
        2.0,
        ge=0,
        description="a difference of this many standard deviations of what noise makes of two "
        "steps is no evidence",
    )
    odometry_noise_factor: float = Field(
        3.0, ge=0, description="with odometry: the same as noise_factor"
    )
    min_odometry_step: float = Field(
        0.15,
        ge=0,
        description="scans are compared over at least this distance, if not for the time [m]",
    )
    max_odometry_step: float = Field(
        1.2,
        gt=0,
        description="and over at most this distance, since scans further apart overlap "
        "too little to contradict wheels [m]",
    )
    max_odometry_duration: float = Field(
        0.3, gt=0, description="or after this time, since wheels may not turn while it moves [s]"
    )
    max_standstill: float = Field(
        0.0,
        ge=0,
        description="odometry that has not moved at all for less than this is left alone: it may "
        "repeat a reading, and catch up [s]",
    )
    min_odometry_error: float = Field(
        0.06, ge=0, description="smaller errors of its step are left to the odometry [m]"
    )
    odometry_cost_ratio: float = Field(
        2.0,
        ge=1,
        description="and its step must fit worse than another by this factor, unless that fits "
        "closely: clutter and jitter of the stamps make all steps fit badly",
    )
    max_loss_share: float = Field(
        0.05,
        ge=0,
        description="and what fits worse at the other step must be less than this share of what "
        "fits better, unless all fits closely: people walk along, walls do not",
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

    resolution: float = Field(0.05, ge=0.001, description="edge of a pixel, r [m]")
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
    max_return_gap: float = Field(
        0.4,
        ge=0,
        description="distance up to which neighbouring returns on a straight wall are connected: "
        "the cells between them are hit, too; 0: none [m]",
    )
    max_wall_bend_deg: float = Field(
        15.0, gt=0, lt=90, description="bend up to which a wall counts as straight there [deg]"
    )


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
