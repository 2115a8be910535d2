# SPDX-License-Identifier: Apache-2.0
"""Why a pair of node and finished submap is not searched."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.pair_counts import PairCounts
from cartoloop.kernels.due_pairs import NodePlace


class WhyNot(Enum):
    """Why a pair is not requested."""

    OWN_SUBMAP = "the node was inserted into this submap"
    FEW_POINTS = "the scan has too few returns"
    TOO_FAR = "submap and node are too far apart"
    WIDE_SEARCH = "the path between them is long: composite scans are searched instead"
    EVERY_NTH_NODE = "only every n-th node is searched"
    WELL_CONSTRAINED = "the pair is well constrained, and only every n-th such node is searched"
    ENOUGH_SEARCHES = "enough nodes of the same submap were searched: they are well constrained"
    ENOUGH_CLOSURES = "enough closures between the two submaps were found"


class PairVerdict(NamedTuple):
    """Whether a pair would be requested.

    Attributes
    ----------
    why_not : None if it would.
    distance : between submap and node [m].
    path_length : of the shortest known path between them, in which metres between sparse scans
        count ``sparse_drift`` times [m].
    """

    why_not: WhyNot | None
    distance: float
    path_length: float


def why_not(
    config: ConstraintSearchConfig,
    counts: PairCounts,
    place: NodePlace,
    submap: int,
    distance: float,
    path_length: float,
    *,
    has_few_points: bool,
) -> WhyNot | None:
    """Return the first reason why a pair is not requested, None if it is.

    Parameters
    ----------
    counts : of the searches and closures so far.
    place : of the node.
    distance, path_length : between submap and node, see `PairVerdict`.
    has_few_points : whether the node has too few returns to be searched.
    """
    number, pair = submap + place.node, (submap, place.first_submap)
    well_constrained = path_length < config.well_constrained_length
    skipped = number % config.every_nth_node != 0
    skipped_well_constrained = number % config.every_nth_well_constrained_node != 0
    tests = {
        WhyNot.OWN_SUBMAP: submap in (place.first_submap, place.last_submap),
        WhyNot.FEW_POINTS: has_few_points,
        WhyNot.TOO_FAR: distance > config.max_constraint_distance,
        WhyNot.WIDE_SEARCH: path_length >= config.wide_search.min_path_length,
        WhyNot.WELL_CONSTRAINED: well_constrained and skipped_well_constrained,
        WhyNot.EVERY_NTH_NODE: skipped and not well_constrained,
        WhyNot.ENOUGH_CLOSURES: counts.has_enough_closures(pair),
        WhyNot.ENOUGH_SEARCHES: counts.has_enough_searches(pair, path_length),
    }
    return next((reason for reason, applies in tests.items() if applies), None)
