# SPDX-License-Identifier: Apache-2.0
"""Parameters of global SLAM (section V)."""

from __future__ import annotations

from pydantic import Field

from cartoloop.config.scan_matching import (
    AdaptiveVoxelFilterConfig,
    LeastSquaresMatcherConfig,
)
from cartoloop.config.section import Section
from cartoloop.kernels.pose_adjustment.losses import Loss


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
    min_num_scans: int = Field(
        6, ge=1, description="scans in it, at least: sparse ones come from a longer path"
    )
    max_length: float = Field(
        8.0, ge=0, description="path length that sparse scans come from, at most [m]"
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
        0.38,
        ge=0,
        le=1,
        description="matches below are rejected; where parts overlap a little, they score low",
    )
    min_score_ratio: float = Field(
        0.68, ge=0, le=1, description="or below this share of the score of the submap's own scans"
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
        description="length of a straight wall of the one part on floor of the other, from which "
        "it forbids the join [m], counted 0.3 m beside the other's walls; doors and furniture are "
        "shorter",
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


class RepairConfig(Section):
    """Visits that contradict each other in the finished map.

    Where the examination calls the map doubtful or wrong for that, they are searched in the submaps
    that they contradict.
    """

    enabled: bool = Field(True, description="search where visits contradict each other")
    min_length: float = Field(
        4.0, ge=0, description="if they do so along less of the path, nothing is searched [m]"
    )
    length: float = Field(
        4.0, ge=0, description="path whose scans are matched as one [m]; one alone sees too little"
    )
    linear_window: float = Field(2.0, ge=0, description="search window radius [m]")
    angular_window_deg: float = Field(
        6.0, ge=0, description="and its angle, to each side [deg]: headings are nearly right"
    )
    min_score: float = Field(
        0.35,
        ge=0,
        le=1,
        description="matches below are rejected; visits from another side score low",
    )
    min_margin: float = Field(
        0.03, ge=0, description="the score must exceed that in any other place by this"
    )
    min_determined: float = Field(
        0.15,
        ge=0,
        le=1,
        description="curvature along the direction that a match determines worst, as a share of "
        "that along the best, at least: along bare corridors it is some hundredths",
    )
    max_rounds: int = Field(4, ge=0, description="adjustments, each followed by an examination")
    max_remaining_share: float = Field(
        0.5,
        ge=0,
        le=1,
        description="matches are believed if at most this share of the path still contradicts "
        "itself with them",
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
    sparse_drift: float = Field(
        3.0,
        ge=1,
        description="a metre of path between sparse scans counts as this many: they drift more",
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
    sparse_residual: float = Field(
        0.15, ge=0, description="by which it may be larger in a submap of sparse scans"
    )
    max_refinement: float = Field(
        0.3,
        gt=0,
        description="at the end, matches farther from the adjusted pose are rejected [m]",
    )
    wide_search: WideSearchConfig = WideSearchConfig()
    join: JoinConfig = JoinConfig()
    repair: RepairConfig = RepairConfig()


class PoseAdjustmentConfig(Section):
    """Section V-A: the optimisation problem (SPA)."""

    loss: Loss = Field(Loss.TRUNCATED, description="robust loss of loop closures: rho of (SPA)")
    loss_scale: float | None = Field(
        None,
        gt=0,
        description="residual E beyond which a closure's influence is limited; unless set, the "
        "default of the loss: 10 for truncated, 6 for graduated_non_convexity, 3 for others",
    )
    intra_submap_weight: float = Field(
        0.7,
        gt=0,
        description="share of the information of scan matches that is used: submaps are distorted",
    )
    mapping_share: float = Field(
        0.15,
        gt=0,
        le=1,
        description="share of that while mapping: from a chain of submaps that is too sure of "
        "itself, true loop closures look false",
    )
    flexible_share: float = Field(
        0.05,
        gt=0,
        le=1,
        description="share of it with which is decided again which loop closures are false, if "
        "many seem so: if nearly all agree then, they are taken for true",
    )
    max_chain_chi_square: float = Field(
        4.0,
        gt=0,
        description="chi square per degree of freedom of the chain of submaps in the final map, "
        "beyond which it is weighted less in the end, too",
    )
    repaired_share: float = Field(
        0.3,
        gt=0,
        le=1,
        description="share of its information at most, where visits contradicted each other until "
        "few matches made them agree",
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
