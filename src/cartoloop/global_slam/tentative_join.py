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
from cartoloop.global_slam.closure_search import search
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.following import MIN_SEEN_SHARE, SeenAreas
from cartoloop.global_slam.graph_adjustment import GraphAdjustment
from cartoloop.global_slam.join_evidence import TwoParts
from cartoloop.global_slam.pose_graph import ClosureConstraints
from cartoloop.global_slam.refinement import match_again, overlapping_nodes
from cartoloop.global_slam.sessions import NodeSubmaps
from cartoloop.sensor.pose import Pose, compose_all, relative_all, transform_points

EVERY_NTH_NODE = 4
"""One in four nodes of either part is matched to the submaps of the other."""

MAX_SUBMAPS = 40
"""Submaps of either part that are matched, at most: those with the most nodes of the other."""

MAX_ROUNDS = 3
"""Rounds of matching, at most."""


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
) -> Iterator[TwoParts]:
    """Yield copies of two parts with part 1 joined to part 0, in each round bent to fit better.

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
    unmatched = joined.copy()
    for _ in range(MAX_ROUNDS):
        matched = unmatched.copy()
        matched.node_poses[:] = joined.node_poses
        matched.submap_poses[:] = joined.submap_poses
        for matches in _overlap_matches(config, replace(parts, graph=joined)):
            matched.add_loop_closures(matches)
        GraphAdjustment(matched, config, share).run(iterations)
        joined = matched
        yield replace(parts, graph=joined)


def _overlap_matches(config: GlobalSlamConfig, parts: TwoParts) -> list[ClosureConstraints]:
    """Return the matches of nodes of either part in submaps of the other, near where they are.

    Where both parts are true, all nodes are found from where they are. Where they are bent, those
    far from what holds the parts together are not, and are searched nearby, as the map itself does
    once they are joined.
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
    areas = SeenAreas(submaps)
    accepted = []
    for index, nodes in overlaps:
        pose: FloatArray = graph.submap_poses[index]
        matches = match_again(
            submaps[index], pose, nodes, graph.node_poses, parts.node_points, limits
        )
        fits = matches.reason == Reason.FITS
        accepted.append(
            _constraints(
                index,
                matches.node[fits],
                matches.tf_submap_node[fits],
                matches.information[fits],
            )
        )
        left = nodes[np.isin(nodes, matches.node[fits], invert=True)]
        accepted.append(_searched_nearby(limits, parts, index, left, areas))
        submaps[index].release()
    return accepted


def _searched_nearby(
    config: ConstraintSearchConfig, parts: TwoParts, index: int, nodes: IntArray, areas: SeenAreas
) -> ClosureConstraints:
    """Return the matches of nodes in a submap, in the window where the relative pose is well known.

    With the thresholds of matches between parts: where parts overlap a little, scores are low.
    Nodes that see hardly anything of what the submap has seen are left out.
    """
    graph, submap = parts.graph, parts.submaps[index]
    expected = relative_all(graph.submap_poses[index], graph.node_poses[nodes])
    is_seen = np.array(
        [
            areas.share(index, transform_points(Pose(*pose), parts.node_points[node]))
            > MIN_SEEN_SHARE
            for pose, node in zip(expected.tolist(), nodes.tolist(), strict=True)
        ],
        dtype=bool,
    )
    nodes, expected = nodes[is_seen], expected[is_seen]
    count = len(nodes)
    if count == 0:
        return _constraints(index, nodes, expected, np.zeros((0, 3, 3)))
    requests = Requests(
        np.full(count, index, dtype=np.int32),
        nodes.astype(np.int32),
        NodeSubmaps.of(graph).first[nodes].astype(np.int32),
        expected,
        np.full(count, config.min_linear_search_window),
        np.full(count, math.radians(config.min_angular_search_window_deg)),
    )
    low = config.model_copy(
        update={
            "min_score": config.join.min_score,
            "min_score_ratio": config.join.min_score_ratio,
        }
    )
    rows = np.arange(count, dtype=np.int32)
    found = search(submap, rows, requests, parts.node_points, low).matches
    return _constraints(index, nodes[found.row], found.tf_submap_node, found.information)


def _constraints(
    index: int, nodes: IntArray, tf_submap_node: FloatArray, information: FloatArray
) -> ClosureConstraints:
    """Return matches of nodes in a submap as constraints that have no row in the record."""
    count = len(nodes)
    return ClosureConstraints(
        np.full(count, -1), np.full(count, index), nodes, tf_submap_node, information
    )
