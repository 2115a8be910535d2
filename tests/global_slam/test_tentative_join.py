# SPDX-License-Identifier: Apache-2.0
"""Two parts that are joined in a copy of the graph are moved to where they fit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.config import GlobalSlamConfig
from cartoloop.global_slam.closure_search import NO_MATCHES, FinishedSubmap
from cartoloop.global_slam.join_evidence import TwoParts
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.global_slam.tentative_join import tentative_joins
from cartoloop.sensor.pose import Pose, inverse, transform_points
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid

RESOLUTION = 0.05
NOTHING = np.zeros(0, np.int64)
NODES = [Pose(2.0 + 0.1 * i, 2.0, 0.3) for i in range(8)]


def room(unseen_from=160):
    """Return a room of 8 x 5 m with an alcove; only its first columns were seen."""
    cells = np.ones((100, 160), np.uint8)
    cells[[0, 1, -1, -2]] = cells[:, [0, 1, -1, -2]] = 255
    cells[:30, 100:] = 255
    cells[70:90, 40:42] = 255
    cells[:, unseen_from:] = 0
    return FinishedGrid(cells, 0.0, 0.0, RESOLUTION)


def returns(pose):
    """Return the walls of the whole room, as they are seen from a pose in it."""
    cells = room().cells.copy()
    cells[:28, 102:] = 1
    walls = np.argwhere(cells == 255)[::9, ::-1] * RESOLUTION
    return transform_points(inverse(pose), walls)


def two_parts(grid):
    """Return two parts that both are the room: one has the grid, and the scans are of the other."""
    graph = PoseGraph()
    for _ in range(2):
        graph.add_submap((0.0, 0.0, 0.0))
    graph.add_nodes([tuple(pose) for pose in NODES])
    graph.add_constraints(
        ConstraintKind.INTRA_SUBMAP,
        [1] * len(NODES),
        list(range(len(NODES))),
        [tuple(pose) for pose in NODES],
        [1e4 * np.eye(3)] * len(NODES),
    )
    nothing = FinishedGrid(np.zeros((0, 0), np.uint8), 0.0, 0.0, RESOLUTION)
    submaps = [FinishedSubmap(0, grid, 0.8), FinishedSubmap(1, nothing, 0.8)]
    points = ScanPoints.of([returns(pose) for pose in NODES])
    return TwoParts(graph, submaps, points, np.ones(len(NODES), np.int64), np.array([0, 1]))


def joined(parts, placed):
    nothing = (NO_MATCHES, NOTHING, NOTHING)
    *_, (last, _) = tentative_joins(GlobalSlamConfig(), parts, placed, nothing)
    return last.graph


@pytest.mark.parametrize("placed", [Pose(0.1, 0.05, 0.01), Pose(0.3, -0.35, 0.05)])
def test_part_moves_to_where_it_fits(placed):
    graph = joined(two_parts(room()), placed)
    np.testing.assert_allclose(graph.node_poses, NODES, atol=0.03)


def test_part_that_is_half_seen_moves_there():
    graph = joined(two_parts(room(unseen_from=90)), Pose(0.3, -0.35, 0.05))
    np.testing.assert_allclose(graph.node_poses, NODES, atol=0.03)


@pytest.mark.parametrize("unseen_from", [50, 60])
def test_part_that_is_hardly_seen_stays(unseen_from, monkeypatch):
    placed = Pose(0.3, -0.35, 0.05)

    def moved():
        graph = joined(two_parts(room(unseen_from)), placed)
        return math.dist(graph.submap_poses[1][:2], placed[:2])

    assert moved() < 1e-6
    # The rest of the room would be enough for a match.
    monkeypatch.setattr("cartoloop.global_slam.tentative_join.MIN_SEEN_SHARE", 0.0)
    assert moved() > 0.4


def test_searches_nearby_state_their_threshold():
    parts = two_parts(room())
    # Its own scans fit worse than usual.
    submaps = [FinishedSubmap(0, parts.submaps[0].grid, 0.5), parts.submaps[1]]
    nothing = (NO_MATCHES, NOTHING, NOTHING)
    first, *_ = tentative_joins(
        GlobalSlamConfig(), replace(parts, submaps=submaps), Pose(0.3, -0.35, 0.05), nothing
    )
    scores = first[1].min_score
    assert len(scores) == len(first[1].matches.row) > 0
    join = GlobalSlamConfig().constraint_search.join
    assert 0.5 * join.min_score_ratio < join.min_score
    np.testing.assert_allclose(scores, 0.5 * join.min_score_ratio)


def test_the_graph_itself_stays():
    parts = two_parts(room())
    joined(parts, Pose(0.3, -0.35, 0.05))
    np.testing.assert_array_equal(parts.graph.node_poses, NODES)
    assert parts.graph.num_loop_closures == 0


def test_what_is_kept_for_the_next_round_changes_nothing(monkeypatch):
    placed, released, release = Pose(0.3, -0.35, 0.05), [], FinishedSubmap.release

    def counted(submap):
        released.append(submap.index)
        release(submap)

    monkeypatch.setattr(FinishedSubmap, "release", counted)
    graphs = [joined(two_parts(room()), placed)]
    assert released == [0, 1]  # both, after all rounds
    monkeypatch.setattr("cartoloop.global_slam.tentative_join.KEPT_BYTES", 0)
    graphs.append(joined(two_parts(room()), placed))
    assert released == [0, 1, 0, 0, 0]  # that which overlaps, after each round

    np.testing.assert_array_equal(graphs[0].node_poses, graphs[1].node_poses)
    np.testing.assert_array_equal(graphs[0].submap_poses, graphs[1].submap_poses)
