# SPDX-License-Identifier: Apache-2.0
"""Parameters of finished maps: export, verdict, lifelong use."""

from __future__ import annotations

from pydantic import Field

from cartoloop.config.section import Section


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
    visit_distance: float = Field(
        15.0,
        gt=0,
        description="nodes that come back after a path three times as long are compared up to "
        "this distance: visits must also agree where a place is only seen [m]",
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
        0.5,
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
        0.7,
        gt=0,
        le=1,
        description="a submap is removed if later sessions have seen this share of its cells",
    )
    revisit_distance: float = Field(
        3.0,
        gt=0,
        description="and if half of its nodes have a node of a later session within this distance, "
        "so that it was not only seen from afar [m]",
    )
    max_lost_wall: float = Field(
        0.5,
        ge=0,
        description="and if at most so much wall lies outside the grids of later submaps, where it "
        "cannot be copied to [m]",
    )
    max_lost_floor: float = Field(1.0, ge=0, description="the same of free floor [m^2]")
    max_growth: float = Field(
        1.0,
        ge=0,
        le=100,
        description="by which the grids of later submaps grow on each side to take what is just "
        "outside, as the far sides of outer walls [m]",
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
