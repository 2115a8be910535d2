# SPDX-License-Identifier: Apache-2.0
"""Weak bundles in graphs made by hand: loops that are closed by many closures, or by few."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.quality.pairs import path_lengths
from cartoloop.quality.weak_closures import weak_bundles

STEP_M, PER_SUBMAP = 0.5, 20


def ring(rounds, length=200.0):
    """Return the graph of a robot that drives around a circle, without loop closures."""
    count = int(rounds * length / STEP_M)
    angles = np.arange(count) * 2.0 * math.pi * STEP_M / length
    radius = length / (2.0 * math.pi)
    poses = np.column_stack((radius * np.cos(angles), radius * np.sin(angles), angles))
    graph = PoseGraph()
    graph.add_nodes(poses)
    graph.add_submaps(poses[::PER_SUBMAP])
    nodes = np.arange(count)
    add(graph, ConstraintKind.INTRA_SUBMAP, nodes // PER_SUBMAP, nodes)
    return graph


def add(graph, kind, submaps, nodes):
    nodes = np.asarray(nodes)
    relative = np.zeros((len(nodes), 3))
    information = np.tile(np.eye(3), (len(nodes), 1, 1))
    graph.add_constraints(
        np.full(len(nodes), kind), np.asarray(submaps), nodes, relative, information
    )


def close(graph, nodes, length=200.0):
    """Add a closure of each node to the submap of one round before."""
    before = np.asarray(nodes) - round(length / STEP_M)
    add(graph, ConstraintKind.LOOP_CLOSURE, before // PER_SUBMAP, nodes)


def found(graph, min_detour=50.0):
    return weak_bundles(graph, path_lengths(graph.node_poses), min_detour)


def test_without_closures_there_are_no_bundles():
    assert found(ring(1.5)) == []


def test_a_loop_that_few_closures_close_is_weak():
    graph = ring(1.3)
    close(graph, [450, 451])

    (bundle,) = found(graph)

    assert bundle.num_closures == 2
    assert bundle.detour == pytest.approx(200.0, abs=8.0)
    assert {450, 451} <= set(bundle.nodes.tolist())


def test_a_loop_that_is_driven_twice_is_not():
    graph = ring(1.3)
    close(graph, range(420, 500))

    assert found(graph) == []


def test_another_bundle_nearby_holds_as_well():
    graph = ring(1.5)
    close(graph, [420])
    close(graph, range(460, 520))

    assert found(graph) == []
    assert [bundle.num_closures for bundle in found(graph, min_detour=20.0)] == [1]


def test_detours_lead_over_other_bundles():
    graph = ring(2.6)
    close(graph, range(420, 560))
    close(graph, [900])  # of the third round to the second; the first bundle is no detour around it

    (bundle,) = found(graph)

    assert bundle.nodes.tolist() == pytest.approx([500, 900], abs=1)
    assert bundle.detour == pytest.approx(200.0, abs=8.0)
