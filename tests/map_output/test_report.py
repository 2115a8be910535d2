# SPDX-License-Identifier: Apache-2.0
"""What the report counts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.map_output.report import peak_memory_mb, summarize_constraints
from tests.global_slam.closures import closure, closures


def graph_with_closures(*errors):
    """One submap, a node seen from it, and closures that are off by the given (x, degrees)."""
    graph = PoseGraph()
    graph.add_submap((0.0, 0.0, 0.0))
    graph.add_node((2.0, 0.0, 0.0))
    graph.add_constraint(ConstraintKind.INTRA_SUBMAP, 0, 0, (9.0, 9.0, 1.0), np.eye(3))
    for x, degrees in errors:
        seen = (2.0 + x, 0.0, math.radians(degrees))
        graph.add_constraint(ConstraintKind.LOOP_CLOSURE, 0, 0, seen, np.eye(3))
    return graph


def test_closures_within_20_cm_and_1_degree_are_true():
    graph = graph_with_closures((0.0, 0.0), (0.19, 0.9), (-0.21, 0.0), (0.0, -1.1), (0.1, -0.5))

    summary = summarize_constraints(graph, searched=17)

    assert summary.intra_submap == 1
    assert summary.loop_closure == 5
    assert summary.searched == 17
    assert summary.precision == pytest.approx(3 / 5)


def test_what_searches_found_is_judged_by_the_poses_in_the_end():
    found = closures(
        *(
            closure(0, 0, (2.0 + x, 0.0, math.radians(degrees)))
            for x, degrees in ((0.1, 0.0), (0.0, 1.5), (0.3, 0.0), (0.0, -0.5))
        )
    )
    summary = summarize_constraints(graph_with_closures((0.0, 0.0)), searched=17, found=found)

    assert summary.found == 4
    assert summary.found_precision == pytest.approx(0.5)
    assert summary.precision == 1.0


@pytest.mark.parametrize("graph", [PoseGraph(), graph_with_closures()])
def test_without_closures_there_is_no_precision(graph):
    summary = summarize_constraints(graph, 0)

    assert summary.precision is None
    assert summary.found_precision is None


def test_memory_is_measured():
    assert 10 < peak_memory_mb() < 1e5
