# SPDX-License-Identifier: Apache-2.0
"""Visits that contradict a submap are matched to it, if the map contradicts itself less then."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.config import Config
from cartoloop.global_slam import repair
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.constraint_search import ConstraintSearch
from cartoloop.global_slam.pose_graph import NO_ROW, ConstraintKind, PoseGraph
from cartoloop.global_slam.repair import (
    MAX_TEAR_M,
    NEAR_OBSERVED_M,
    Contradicted,
    Contradictions,
    Repair,
    add_closures,
    are_torn,
    determined_share,
    near_observed,
)
from cartoloop.sensor.pose import Pose, compose, inverse, relative_all, transform_points
from cartoloop.sensor.scan_points import NodePoints, ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid

OFF = Pose(0.3, -0.4, math.radians(1.5))
"""How far the second visit is off."""

PILLARS = ((2.0, 1.5), (4.5, 5.0), (7.0, 2.5), (8.5, 6.5), (3.0, 6.0), (6.0, 0.8))


def room(pillars=PILLARS):
    """Return a room of 10 by 8 m with pillars of 0.3 m; all of it was observed."""
    cells = np.ones((160, 200), np.uint8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = 255, 255, 255, 255
    for x, y in pillars:
        row, col = round(y / 0.05), round(x / 0.05)
        cells[row : row + 6, col : col + 6] = 255
    return FinishedGrid(np.pad(cells, 20), 0.0, 0.0, 0.05)


def bare():
    """Return two long walls that look the same all along."""
    cells = np.ones((160, 200), np.uint8)
    cells[:2], cells[-2:] = 255, 255
    return FinishedGrid(np.pad(cells, 20), 0.0, 0.0, 0.05)


class TwoVisits:
    """A room that is visited twice; the second visit is a submap that nothing holds.

    Attributes
    ----------
    graph : two submaps, ten nodes each.
    later : true poses of the nodes of the second visit, in the frame of the first.
    """

    def __init__(self, grid):
        self.grid = grid
        rng = np.random.default_rng(2)
        cells = rng.permutation(np.argwhere(grid.cells == 255))
        walls = cells[: len(cells) // 2, ::-1] * grid.resolution
        walls = walls + rng.normal(0.0, 0.01, walls.shape)
        first = [Pose(x, 5.0, 0.0) for x in np.arange(3.0, 5.0, 0.2)]
        self.later = [Pose(x, 4.2, 0.3) for x in np.arange(5.0, 7.0, 0.2)]
        poses = [*first, *self.later]
        self.graph = graph = PoseGraph()
        graph.add_submap((0.0, 0.0, 0.0))
        graph.add_submap(OFF)
        graph.fix_submap(0)
        graph.add_nodes([*first, *(compose(OFF, pose) for pose in self.later)])
        graph.add_constraints(
            ConstraintKind.INTRA_SUBMAP,
            [0] * 10 + [1] * 10,
            range(20),
            [tuple(pose) for pose in poses],
            [1e4 * np.eye(3)] * 20,
        )
        points = NodePoints()
        for pose in poses:
            points.append(transform_points(inverse(pose), walls))
        self.points: ScanPoints = points.view
        self.submaps = [FinishedSubmap(index, grid, 0.8) for index in range(2)]

    def error(self, graph):
        """Return how far the second visit is off in the mean [m]."""
        away = graph.node_poses[10:, :2] - np.array(self.later)[:, :2]
        return float(np.hypot(*away.T).mean())

    def contradictions(self, graph):
        """Return what the examination would: 8 m contradict as long as the visit is off."""
        pose = relative_all(graph.submap_poses[0], graph.node_poses[[15]])[0]
        visits = [Contradicted(0, 15, Pose(*pose))] if self.error(graph) > 0.1 else []
        paths = 0.2 * np.arange(20.0) + np.repeat((0.0, 100.0), 10)
        return Contradictions(visits, 8.0 * len(visits), paths)

    def repaired(self, find=None, settings=()):
        config = Config().global_slam
        limits = config.constraint_search.repair.model_copy(update=dict(settings))
        search = config.constraint_search.model_copy(update={"repair": limits})
        config = config.model_copy(update={"constraint_search": search})
        search = ConstraintSearch(
            config.constraint_search, Closures(), self.submaps, NodePoints(), 1
        )
        try:
            return Repair(config, self.submaps, self.points, search).run(
                self.graph, find or self.contradictions
            )
        finally:
            search.close()


def test_a_visit_that_contradicts_is_matched():
    visits = TwoVisits(room())
    before = visits.graph.node_poses.copy()
    repaired = visits.repaired()
    assert visits.error(visits.graph) > 0.3
    assert visits.error(repaired.graph) < 0.03
    np.testing.assert_array_equal(visits.graph.node_poses, before)
    assert [(s, n) for s, n in zip(*repaired.closures[:2], strict=True)] == [(0, 15)]
    assert repaired.closures.reason.tolist() == [Reason.REPAIR]
    assert repaired.summary()["repair"] == {
        "closures": 1,
        "contradicted_before_m": 8.0,
        "contradicted_after_m": 0.0,
    }


def test_what_does_not_help_is_not_believed():
    visits = TwoVisits(room())

    def never_better(graph):
        return visits.contradictions(graph)._replace(length=8.0)

    assert visits.repaired(never_better) is None


def test_a_small_gain_is_not_believed():
    visits = TwoVisits(room())

    def hardly_better(graph):
        found = visits.contradictions(graph)
        return found._replace(length=8.0 if found.visits else 7.0)

    assert visits.repaired(hardly_better) is None


def test_walls_that_fit_all_along_show_no_place():
    assert TwoVisits(bare()).repaired() is None


def test_a_visit_is_searched_once():
    visits, asked = TwoVisits(room()), []

    def still_there(graph):
        asked.append(graph)
        pose = relative_all(graph.submap_poses[0], graph.node_poses[[15]])[0]
        found = visits.contradictions(visits.graph)
        return found._replace(
            visits=[Contradicted(0, 15, Pose(*pose))], length=8.0 / len(asked) ** 2
        )

    assert len(visits.repaired(still_there).closures.node) == 1
    assert len(asked) == 2


def test_a_match_that_takes_one_scan_out_of_its_path_is_false(monkeypatch):
    monkeypatch.setattr(repair, "MAX_TEAR_M", 0.2)
    visits, lengths = TwoVisits(room()), iter((8.0, 0.0, 8.0, 0.0))

    def better_with_it(graph):
        return visits.contradictions(visits.graph)._replace(length=next(lengths))

    assert len(visits.repaired(better_with_it).closures.node) == 1
    visits.graph.fix_submap(1)
    assert len(visits.repaired(better_with_it).closures.node) == 0


def test_nodes_moved_within_their_submaps_are_torn():
    graph = TwoVisits(room()).graph
    graph.node_poses[15, 0] += 2.0 * MAX_TEAR_M
    graph.node_poses[16, 0] += 0.5 * MAX_TEAR_M
    assert are_torn(graph, np.array([3, 16, 15, 15])).tolist() == [False, False, True, True]


def test_without_contradictions_nothing_is_searched():
    visits = TwoVisits(room())
    nothing = Contradictions([], 0.0, np.zeros(20))
    assert visits.repaired(lambda _: nothing) is None


def test_closures_that_the_last_pass_found_are_left_out():
    visits = TwoVisits(room())
    repaired = visits.repaired()
    assert len(repaired.without_matched(visits.graph).node) == 1
    graph = visits.graph.copy()
    add_closures(graph, repaired.closures, np.array([NO_ROW]))
    assert graph.num_loop_closures == 1
    assert graph.is_trusted[-1]
    assert len(repaired.without_matched(graph).node) == 0


@given(st.integers(0, 2**32 - 1))
def test_points_near_observed_cells_are_kept(seed):
    rng = np.random.default_rng(seed)
    cells = (rng.random((9, 12)) < 0.1).astype(np.uint8)
    grid = FinishedGrid(cells, -0.2, 0.1, 0.1)
    pose = Pose(*rng.uniform(-0.5, 0.5, 2), rng.uniform(-3.0, 3.0))
    points = rng.uniform(-1.0, 2.0, (40, 2))
    reach = round(NEAR_OBSERVED_M / 0.1)
    expected = []
    for x, y in transform_points(pose, points):
        col, row = round((x + 0.2) / 0.1), round((y - 0.1) / 0.1)
        steps = [abs(r - row) + abs(c - col) for r, c in np.argwhere(cells).tolist()]
        expected.append(min(steps, default=99) <= reach)
    assert near_observed(grid, pose, points).tolist() == expected


def test_a_corridor_leaves_a_direction_open():
    along, across = np.array((1.0, 0.02)), np.array((-0.02, 1.0))
    walls = [np.append(across, lever) for lever in (-3.0, 0.0, 3.0)]
    bare = sum(np.outer(row, row) for row in walls)
    end = np.outer(np.append(along, 0.5), np.append(along, 0.5))
    assert determined_share(bare + 0.01 * end) < 0.01
    assert determined_share(bare + end) > 0.3
    assert determined_share(np.zeros((3, 3))) == 0.0


def test_matches_that_leave_a_direction_open_are_not_believed():
    visits = TwoVisits(room())
    assert visits.repaired() is not None
    assert visits.repaired(settings={"min_determined": 0.99}) is None


def test_the_record_knows_that_a_map_was_repaired():
    visits, closures = TwoVisits(room()), Closures()
    assert not closures.is_repaired
    rows = closures.note_repaired(visits.repaired().closures)
    assert closures.is_repaired
    assert closures.reason[rows].tolist() == [Reason.REPAIR]
    assert closures.measured.node.tolist() == [15]
