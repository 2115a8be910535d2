# SPDX-License-Identifier: Apache-2.0
"""Ends of sessions in corridors: where along them they are, if all scans show it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.config import Config
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.join_evidence import GeometryCheck
from cartoloop.global_slam.pair_selection import NO_REQUESTS
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.global_slam.session_ends import SessionEnds, session_ends, standing_out
from cartoloop.global_slam.sessions import SessionRanges
from cartoloop.part_check import part_check
from cartoloop.sensor.pose import Pose, compose, compose_all, inverse, transform_points
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid
from tests.global_slam.closures import requests

SLIDES = np.arange(-3.0, 3.01, 0.25)


def place(shares, returns=2000, contradicts=False):
    checks = [
        GeometryCheck(0.0, 0.0, round(returns * (1.0 - share)), round(returns * share), "")
        for share in shares
    ]
    return standing_out(SLIDES, checks, lambda best: contradicts and shares[best] == min(shares))


def with_dip(at=-0.75, share=0.0, elsewhere=0.08):
    return np.where(np.abs(SLIDES - at) < 0.2, share, elsewhere)


def test_the_place_without_returns_on_floor_stands_out():
    assert place(with_dip()) == pytest.approx(-0.75)


def test_places_side_by_side_are_one():
    shares = np.minimum(with_dip(-1.0), with_dip(-0.75))
    assert place(shares) == pytest.approx(-0.875)


@pytest.mark.parametrize(
    "shares",
    [
        np.zeros(len(SLIDES)),
        with_dip(share=0.05, elsewhere=0.2),
        with_dip(share=0.02, elsewhere=0.04),
        np.minimum(with_dip(-0.75), with_dip(2.0)),
    ],
    ids=["bare", "floor everywhere", "hardly better", "two places"],
)
def test_otherwise_none_does(shares):
    assert place(shares) is None


def test_few_returns_show_nothing():
    assert place(with_dip(), returns=250) is None


def test_scans_that_contradict_forbid_the_place():
    assert place(with_dip(), contradicts=True) is None


DOORS = (3.0, 7.4, 9.1, 13.6, 16.2, 21.7, 24.3, 28.8, 31.0)
"""Where niches of a corridor begin [m]; a bare one has none."""

OFF = Pose(1.2, 3.0, math.radians(4.0))
"""How far the second session is off."""


def corridor(length, doors=DOORS):
    """Return a corridor along x, 3 m wide, with niches of 0.9 m on one side."""
    cells = np.ones((100, round(length / 0.05)), np.uint8)
    cells[:22], cells[78:] = 0, 0
    cells[20:22] = cells[78:80] = 255
    for door in doors:
        begin, end = round(door / 0.05), round((door + 0.9) / 0.05)
        cells[78:80, begin:end] = 1
        cells[80:90, begin - 2 : end + 2] = 255
        cells[80:88, begin:end] = 1
    return FinishedGrid(cells, 0.0, -2.5, 0.05)


def two_sessions(doors):
    """Return a graph of two sessions in a corridor; the second one is held nowhere."""
    length = 36.0
    grid = corridor(length, doors)
    walls = np.argwhere(grid.cells == 255)[::3, ::-1] * 0.05 + (0.025, -2.475)
    rng = np.random.default_rng(1)
    walls = walls + rng.normal(0.0, 0.01, walls.shape)
    true = [Pose(x, 0.1 * math.sin(x), 0.05 * math.cos(x)) for x in np.arange(2.0, 18.0, 0.25)]
    later = [Pose(x, -0.1 * math.sin(x), 0.05) for x in np.arange(14.0, 32.0, 0.25)]
    graph = PoseGraph()
    graph.add_submap((0.0, 0.0, 0.0))
    graph.add_submap(OFF)
    graph.fix_submap(0)
    graph.add_nodes([*true, *(compose(OFF, pose) for pose in later)])
    poses = [*true, *later]
    of_submap = [0] * len(true) + [1] * len(later)
    graph.add_constraints(
        ConstraintKind.INTRA_SUBMAP,
        of_submap,
        list(range(len(poses))),
        [tuple(pose) for pose in poses],
        [1e4 * np.eye(3)] * len(poses),
    )
    seen = [walls[np.hypot(*(walls - pose[:2]).T) < 7.0] for pose in poses]
    points = [transform_points(inverse(pose), each) for pose, each in zip(poses, seen, strict=True)]
    submaps = []
    for index, (low, high) in enumerate(((0.0, 24.0), (8.0, length))):
        cells = grid.cells.copy()
        cells[:, : round(low / 0.05)] = cells[:, round(high / 0.05) :] = 0
        submaps.append(FinishedSubmap(index, FinishedGrid(cells, 0.0, -2.5, 0.05), 0.8))
    sessions = SessionRanges()
    sessions.begin(0, 0, 0)
    sessions.begin(len(true), 1, 0)
    return graph, submaps, ScanPoints.of(points), sessions, later


class LongPaths:
    """All pairs of sessions are far from each other along the path."""

    def wide_pairs(self, graph, node, submaps, _):
        of_second = node >= np.count_nonzero(graph.index_a == 0)
        submap = 0 if of_second else 1
        seen = compose_all(
            np.array(inverse(Pose(*graph.submap_poses[submap]))), graph.node_poses[node][None]
        )
        pair = requests((submap, node))
        return pair._replace(
            tf_submap_node=seen,
            linear_window=np.full(1, 6.0),
            angular_window=np.full(1, math.radians(8.0)),
        )


def closures(doors=DOORS):
    graph, submaps, points, sessions, later = two_sessions(doors)
    config = Config()
    ends = SessionEnds(config.global_slam, submaps, sessions, part_check(config))
    return next(ends.closures(graph, LongPaths(), points), None), later


def test_an_end_is_found_in_a_corridor_with_doors():
    held, later = closures()
    assert held is not None
    requested = held.requests
    assert len(requested.node) >= 4
    assert (requested.submap == requested.submap[0]).all()
    true = two_sessions(DOORS)[0]
    poses = np.array([*true.node_poses[: len(true.node_poses) - len(later)], *later])
    error = held.matches.tf_submap_node - poses[requested.node]
    assert np.hypot(error[:, 0], error[:, 1]).max() < 0.25
    assert np.abs(error[:, 2]).max() < math.radians(1.0)


def test_an_end_in_a_bare_corridor_stays():
    assert closures(doors=())[0] is None


def test_without_a_check_no_end_is_held():
    graph, submaps, points, sessions, _ = two_sessions(DOORS)
    ends = SessionEnds(Config().global_slam, submaps, sessions, None)
    assert list(ends.closures(graph, LongPaths(), points)) == []


def test_other_parts_are_left_alone():
    graph, submaps, points, sessions, _ = two_sessions(DOORS)
    sessions.parts[1] = 1
    ends = SessionEnds(Config().global_slam, submaps, sessions, part_check(Config()))
    assert list(ends.closures(graph, LongPaths(), points)) == []


def test_ends_that_the_drift_hardly_moves_are_left_alone():
    graph, submaps, points, sessions, _ = two_sessions(DOORS)

    class ShortPaths(LongPaths):
        def wide_pairs(self, *_):
            return NO_REQUESTS

    ends = SessionEnds(Config().global_slam, submaps, sessions, part_check(Config()))
    assert list(ends.closures(graph, ShortPaths(), points)) == []


def test_ends_are_the_first_and_last_metres():
    graph = PoseGraph()
    graph.add_nodes([(float(x), 0.0, 0.0) for x in [*range(20), *range(100, 103)]])
    sessions = SessionRanges()
    for first in (0, 20):
        sessions.begin(first, 0, 0)
    found = [
        (session, end, nodes.tolist()) for session, end, nodes in session_ends(graph, sessions)
    ]
    assert found == [
        (0, 0, [0, 1, 2, 3, 4, 5]),
        (0, 19, [14, 15, 16, 17, 18, 19]),
        (1, 20, [20, 21, 22]),
        (1, 22, [20, 21, 22]),
    ]
