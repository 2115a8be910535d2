# SPDX-License-Identifier: Apache-2.0
"""Two parts placed in a copy of the graph, adjusted and matched where they overlap."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import ConstraintSearchConfig, GlobalSlamConfig
from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.closure_search import FinishedSubmap, search
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.following import MIN_SEEN_SHARE, SeenAreas
from cartoloop.global_slam.graph_adjustment import GraphAdjustment
from cartoloop.global_slam.join_evidence import Nearby, TwoParts
from cartoloop.global_slam.join_records import NO_NEARBY, as_one
from cartoloop.global_slam.part_drift import Drift, drift_of
from cartoloop.global_slam.pose_graph import ClosureConstraints
from cartoloop.global_slam.refinement import match_again, overlapping_nodes
from cartoloop.global_slam.sessions import NodeSubmaps
from cartoloop.sensor.pose import Pose, compose_all, relative_all
from cartoloop.sensor.scan_points import ScanPoints

EVERY_NTH_NODE = 4
"""One in four nodes of either part is matched to the submaps of the other."""

MAX_SUBMAPS = 40
"""Submaps of either part that are matched, at most: those with the most nodes of the other."""

MAX_ROUNDS = 3
"""Rounds of matching, at most."""

KEPT_BYTES = 64 << 20
"""What searches compute of submaps is kept from round to round if it is not more [bytes]."""


def place_part(parts: TwoParts, tf_one_other: Pose) -> None:
    """Move the nodes and submaps of part 1 into the frame of part 0, in place."""
    graph, pose = parts.graph, np.array(tf_one_other)
    nodes, submaps = np.flatnonzero(parts.of_nodes == 1), np.flatnonzero(parts.of_submaps == 1)
    graph.node_poses[nodes] = compose_all(pose, graph.node_poses[nodes])
    graph.submap_poses[submaps] = compose_all(pose, graph.submap_poses[submaps])


def tentative_joins(
    config: GlobalSlamConfig,
    parts: TwoParts,
    tf_one_other: Pose,
    closures: tuple[SearchMatches, IntArray, IntArray],
) -> Iterator[tuple[TwoParts, Nearby]]:
    """Yield copies of two parts with part 1 joined to part 0, in each round bent to fit better.

    And the matches that had to be searched, without which the map would not keep that shape.

    One round does where both parts are true. Where one is stretched, most of its nodes are too far
    from where they fit to be matched at first. The chain of submaps counts as much as it does while
    mapping, so that what is examined is what the map will be.

    Parameters
    ----------
    closures : of the join, with the submap and the node of each.
    """
    joined = parts.graph.copy()
    place_part(replace(parts, graph=joined), tf_one_other)
    found, of_submap, of_node = closures
    joined.add_loop_closures(
        ClosureConstraints(
            np.full(len(found.row), -1), of_submap, of_node, found.tf_submap_node, found.information
        ),
        are_trusted=True,
    )
    iterations = config.pose_adjustment.max_num_final_iterations
    share = config.pose_adjustment.mapping_share
    GraphAdjustment(joined, config, share).run(iterations)
    unmatched, areas = joined.copy(), SeenAreas(parts.submaps)
    own = [parts.submaps[index] for part in (0, 1) for index in parts.submaps_of(part).tolist()]
    keeps = sum(submap.search_bytes for submap in own) <= KEPT_BYTES
    try:
        for _ in range(MAX_ROUNDS):
            matched = unmatched.copy()
            matched.node_poses[:] = joined.node_poses
            matched.submap_poses[:] = joined.submap_poses
            placed = replace(parts, graph=joined)
            constraints, nearby = _overlap_matches(config, placed, areas, keeps=keeps)
            for each in (*constraints, _constraints(nearby)):
                matched.add_loop_closures(each)
            GraphAdjustment(matched, config, share).run(iterations)
            joined = matched
            yield replace(parts, graph=joined), nearby
    finally:
        for submap in own if keeps else ():
            submap.release()


def _overlap_matches(
    config: GlobalSlamConfig, parts: TwoParts, areas: SeenAreas, *, keeps: bool
) -> tuple[list[ClosureConstraints], Nearby]:
    """Return the matches of nodes of either part in submaps of the other, near where they are.

    Where both parts are true, all nodes are found from where they are. Where they are bent, those
    far from what holds the parts together are not, and are searched nearby, as the map itself does
    once they are joined.

    Parameters
    ----------
    keeps : whether what is computed of submaps is kept for the next round.
    """
    graph, submaps, limits = parts.graph, parts.submaps, config.constraint_search
    overlaps: list[tuple[int, IntArray]] = []
    for part in (0, 1):
        of_other = parts.nodes_of(1 - part)
        found = []
        for index in parts.submaps_of(part).tolist():
            nodes = overlapping_nodes(
                submaps[index], graph.submap_poses[index], graph.node_poses, set(), EVERY_NTH_NODE
            )
            nodes = nodes[of_other[nodes]]
            if len(nodes):
                found.append((index, nodes))
        found.sort(key=lambda each: (-len(each[1]), each[0]))
        overlaps += found[:MAX_SUBMAPS]
    own_submaps, drift = NodeSubmaps.of(graph).first, drift_of(parts)
    accepted, searched = [], []
    for index, nodes in overlaps:
        pose: FloatArray = graph.submap_poses[index]
        matches = match_again(
            submaps[index], pose, nodes, graph.node_poses, parts.node_points, limits
        )
        fits = matches.reason == Reason.FITS
        accepted.append(
            ClosureConstraints(
                np.full(int(np.count_nonzero(fits)), -1),
                matches.submap[fits],
                matches.node[fits],
                matches.tf_submap_node[fits],
                matches.information[fits],
            )
        )
        left = nodes[np.isin(nodes, matches.node[fits], invert=True)]
        requests = _requests_nearby(limits, parts, index, left, areas, own_submaps, drift)
        searched.append(_searched(limits, submaps[index], requests, parts.node_points))
        if not keeps:
            submaps[index].release()
    return accepted, as_one(searched)


def _requests_nearby(
    config: ConstraintSearchConfig,
    parts: TwoParts,
    index: int,
    nodes: IntArray,
    areas: SeenAreas,
    own_submaps: IntArray,
    drift: Drift,
) -> Requests:
    """Return the searches of nodes in a submap, in the window of pairs that are well constrained.

    Nodes that see hardly anything of what the submap has seen are left out.

    Parameters
    ----------
    drift : by which the windows are larger.
    """
    graph = parts.graph
    expected = relative_all(graph.submap_poses[index], graph.node_poses[nodes])
    is_seen = areas.shares(index, parts.node_points.take(nodes), expected) > MIN_SEEN_SHARE
    nodes = nodes[is_seen]
    return Requests(
        np.full(len(nodes), index, dtype=np.int32),
        nodes.astype(np.int32),
        own_submaps[nodes].astype(np.int32),
        expected[is_seen],
        config.min_linear_search_window + drift.between(nodes, index),
        np.full(len(nodes), math.radians(config.min_angular_search_window_deg)),
    )


def _searched(
    config: ConstraintSearchConfig,
    submap: FinishedSubmap,
    requests: Requests,
    node_points: ScanPoints,
) -> Nearby:
    """Return where nodes fit in a submap, with the thresholds of matches between parts.

    Where parts overlap a little, scores are low.
    """
    if len(requests.node) == 0:
        return NO_NEARBY
    join = config.join
    low = config.model_copy(
        update={"min_score": join.min_score, "min_score_ratio": join.min_score_ratio}
    )
    rows = np.arange(len(requests.node), dtype=np.int32)
    outcome = search(submap, rows, requests, node_points, low)
    found = outcome.matches
    chosen = found.row.astype(np.int64)
    return Nearby(
        requests.take(chosen),
        found._replace(row=np.full_like(found.row, -1)),
        np.full(len(chosen), outcome.min_score),
    )


def _constraints(nearby: Nearby) -> ClosureConstraints:
    """Return matches as constraints that have no row in the record."""
    requests, matches, _ = nearby
    return ClosureConstraints(
        matches.row,
        requests.submap,
        requests.node,
        matches.tf_submap_node,
        matches.information,
    )
