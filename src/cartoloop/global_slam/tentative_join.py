# SPDX-License-Identifier: Apache-2.0
"""Two parts placed in a copy of the graph, adjusted and matched where they overlap."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import GlobalSlamConfig
from cartoloop.global_slam.closure_matches import SearchMatches
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.graph_adjustment import GraphAdjustment
from cartoloop.global_slam.join_evidence import TwoParts
from cartoloop.global_slam.pose_graph import ClosureConstraints
from cartoloop.global_slam.refinement import match_again, overlapping_nodes
from cartoloop.sensor.pose import Pose, compose_all

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
    from where they fit to be matched at first.

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
    GraphAdjustment(joined, config).run(iterations)
    unmatched = joined.copy()
    for _ in range(MAX_ROUNDS):
        matched = unmatched.copy()
        matched.node_poses[:] = joined.node_poses
        matched.submap_poses[:] = joined.submap_poses
        for matches in _overlap_matches(config, replace(parts, graph=joined)):
            matched.add_loop_closures(matches)
        GraphAdjustment(matched, config).run(iterations)
        joined = matched
        yield replace(parts, graph=joined)


def _overlap_matches(config: GlobalSlamConfig, parts: TwoParts) -> list[ClosureConstraints]:
    """Return the matches of nodes of either part in submaps of the other, near where they are."""
    graph, submaps = parts.graph, parts.submaps
    search = config.constraint_search
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
    accepted = []
    for index, nodes in overlaps:
        pose: FloatArray = graph.submap_poses[index]
        matches = match_again(
            submaps[index], pose, nodes, graph.node_poses, parts.node_points, search
        )
        submaps[index].release()
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
    return accepted
