# SPDX-License-Identifier: Apache-2.0
"""Returns that lie on walls of a submap that their scan was inserted into."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.quality.confirmed import ConfirmedReturns
from cartoloop.quality.pairs import FLOOR, WALL, cell_value
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid

ON_WALL, BESIDE_WALL, ON_FLOOR, OUTSIDE = (2.0, 0.0), (1.95, 0.5), (1.0, 0.0), (9.0, 0.0)
SCAN = np.array([ON_WALL, ON_FLOOR, BESIDE_WALL, OUTSIDE])


def grid():
    """Return a submap of 6 x 6 m about its origin, with a wall at x = 2 m."""
    cells = np.full((121, 121), cell_value(FLOOR) - 1, np.uint8)
    cells[:, 100] = cell_value(WALL) + 1
    return FinishedGrid(cells, -3.0, -3.0, 0.05)


def seen_from(*poses):
    """Return a graph of one submap and its nodes, and scans that see the same from each."""
    graph, count = PoseGraph(), len(poses)
    graph.add_submap((50.0, -3.0, 1.0))
    graph.add_nodes([(7.0, 7.0, 7.0)] * count)
    graph.add_constraints(
        ConstraintKind.INTRA_SUBMAP, [0] * count, range(count), poses, [np.eye(3)] * count
    )
    scans = []
    for x, y, theta in poses:
        turned = np.array([(np.cos(theta), -np.sin(theta)), (np.sin(theta), np.cos(theta))])
        scans.append((SCAN - (x, y)) @ turned)
    return graph, ScanPoints.of(scans)


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (-1.0, 0.5, 0.7), (1.0, -2.0, -3.0)])
def test_returns_on_own_walls_are_kept_in_order(pose):
    graph, scans = seen_from((0.0, 0.0, 0.0), pose)
    kept = ConfirmedReturns().of(graph, [grid()], scans, np.array([0]))
    assert len(kept) == 2
    for node in range(2):
        np.testing.assert_allclose(kept[node], scans[node][[0, 2]])


def test_nodes_of_other_submaps_have_no_returns_left():
    graph, scans = seen_from((0.0, 0.0, 0.0))
    kept = ConfirmedReturns().of(graph, [grid()], scans, np.zeros(0, np.int64))
    assert kept.counts.tolist() == [0]


def test_one_submap_that_confirms_is_enough():
    graph, scans = seen_from((0.0, 0.0, 0.0))
    graph.add_submap((0.0, 0.0, 0.0))
    graph.add_constraints(ConstraintKind.INTRA_SUBMAP, [1], [0], [(0.0, 0.0, 0.0)], [np.eye(3)])
    bare = FinishedGrid(np.full((121, 121), cell_value(FLOOR) - 1, np.uint8), -3.0, -3.0, 0.05)
    kept = ConfirmedReturns().of(graph, [grid(), bare], scans, np.array([0, 1]))
    np.testing.assert_allclose(kept[0], SCAN[[0, 2]])


def test_submaps_are_looked_at_once(monkeypatch):
    graph, scans = seen_from((0.0, 0.0, 0.0), (-1.0, 0.5, 0.7))
    confirmed = ConfirmedReturns()
    first = confirmed.of(graph, [grid()], scans, np.array([0]))
    monkeypatch.delattr("cartoloop.quality.confirmed.near_walls")
    again = confirmed.of(graph, [grid()], scans, np.array([0]))
    assert len(first[0]) == 2
    for node in range(2):
        np.testing.assert_array_equal(again[node], first[node])


def test_other_submaps_and_nodes_are_looked_at_again():
    graph, scans = seen_from((0.0, 0.0, 0.0))
    confirmed = ConfirmedReturns()
    assert confirmed.of(graph, [grid()], scans, np.array([0])).counts.tolist() == [2]
    assert confirmed.of(graph, [grid()], scans, np.zeros(0, np.int64)).counts.tolist() == [0]

    graph.add_submap((0.0, 0.0, 0.0))
    graph.add_constraints(ConstraintKind.INTRA_SUBMAP, [1], [0], [(1.0, 0.0, 0.0)], [np.eye(3)])
    moved = confirmed.of(graph, [grid(), grid()], scans, np.array([0, 1]))
    assert moved.counts.tolist() == [3]
