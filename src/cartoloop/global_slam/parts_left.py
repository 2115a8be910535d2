# SPDX-License-Identifier: Apache-2.0
"""The searches at the end of a run for the places of parts that nothing connects."""

from __future__ import annotations

from collections.abc import Callable

from cartoloop.global_slam.joining import MAX_FOLLOWING, NUM_ROUNDS
from cartoloop.global_slam.part_joins import PartJoins
from cartoloop.global_slam.pose_graph import PoseGraph


def join_parts_left(
    joins: PartJoins,
    graph: PoseGraph,
    close_loops: Callable[[], None],
    announce: Callable[[str], None],
) -> None:
    """Search the composite scans of parts in the others, until all are joined.

    Parameters
    ----------
    joins : decides which parts are joined.
    graph : of all of them.
    close_loops : waits for the searches, joins what can be joined, and adjusts.
    announce : called with the name of the next step.
    """
    joining = joins.joining
    for number in range(NUM_ROUNDS):
        if not joins.is_needed:
            break
        announce(f"searching parts in each other, {number + 1} of {NUM_ROUNDS}")
        if joining.request_round(number, graph):
            joining.start(graph)
            close_loops()
    # Parts that have grown may be worth a search that they were not before.
    while joins.is_needed and joining.request_round(NUM_ROUNDS, graph):
        announce("searching parts in each other again")
        joining.start(graph)
        close_loops()
    for number in range(MAX_FOLLOWING):
        if not joins.is_needed:
            break
        announce(f"following places where parts may fit, {number + 1} of {MAX_FOLLOWING}")
        if not joining.follow(graph):
            break
        joining.start(graph)
        close_loops()
