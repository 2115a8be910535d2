# SPDX-License-Identifier: Apache-2.0
"""How many returns may lie on floor of another part, by how many do so within the parts."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import JoinConfig, QualityConfig
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.join_evidence import GeometryCheck, TwoParts
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.quality.confirmed import ConfirmedReturns
from cartoloop.quality.joins import (
    MAX_FLOOR_SHARE,
    MIN_USUAL_RETURNS,
    check_geometry,
    count_returns,
    floor_fault,
    usual_floor_share,
)
from cartoloop.quality.pairs import FLOOR, WALL, cell_value
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid


def fault(share, usual, limit=0.08):
    return floor_fault(
        GeometryCheck(50.0, 0.0, round(1000 * (1 - share)), round(1000 * share), ""), limit, usual
    )


def test_little_floor_is_allowed_anywhere():
    assert fault(0.08, 0.0) == ""
    assert "9% of the returns" in fault(0.09, 0.0)


def test_more_is_allowed_where_it_is_usual():
    assert fault(0.1, 0.09) == ""
    assert "10% on floor of their own" not in fault(0.09, 0.07)
    assert "7% on floor of their own" in fault(0.09, 0.07)


@pytest.mark.parametrize("usual", [0.2, 0.9])
def test_what_is_usual_excuses_only_so_much(usual):
    assert fault(MAX_FLOOR_SHARE, usual) == ""
    assert fault(MAX_FLOOR_SHARE + 0.01, usual) != ""


def seen_twice(on_floor, num_nodes=100, *, is_confirmed=True):
    """Return a part of two submaps: the nodes of each see floor of the other one, and walls.

    Parameters
    ----------
    on_floor : share of the returns that lie on its floor; they are walls to their own submap.
    is_confirmed : whether they are.
    """
    graph = PoseGraph()
    grids = []
    for number in range(2):
        cells = np.full((200, 200), cell_value(FLOOR) - 1, np.uint8)
        cells[150:] = cell_value(WALL) + 1
        if is_confirmed:
            cells[60 - 20 * number] = cell_value(WALL) + 1
        grids.append(FinishedGrid(cells, -5.0, -5.0, 0.05))
    for _ in range(2):
        graph.add_submap((0.0, 0.0, 0.0))
    graph.add_nodes([(0.0, 0.0, 0.0)] * (2 * num_nodes))
    for submap in range(2):
        nodes = list(range(submap * num_nodes, (submap + 1) * num_nodes))
        count = len(nodes)
        graph.add_constraints(
            ConstraintKind.INTRA_SUBMAP,
            [submap] * count,
            nodes,
            [(0.0, 0.0, 0.0)] * count,
            [np.eye(3)] * count,
        )
    high = round(20 * on_floor)
    points = []
    for number in range(2):
        y = -2.0 - number
        scan = [(0.1 * i, y if i < high else 3.5) for i in range(20)]
        points += [np.array(scan + scan)] * num_nodes
    submaps = [FinishedSubmap(index, grid, 0.7) for index, grid in enumerate(grids)]
    return graph, submaps, ScanPoints.of(points)


def usual(part, parts):
    nodes = np.repeat(parts, part[0].num_nodes // 2)
    return usual_floor_share(
        TwoParts(*part, nodes, np.array(parts)), QualityConfig(), ConfirmedReturns()
    )


def test_usual_share_is_that_within_the_parts():
    part = seen_twice(0.25)
    assert usual(part, [0, 0]) == pytest.approx(0.25)
    assert usual(part, [1, 1]) == pytest.approx(0.25)


def test_returns_on_the_other_part_are_not_usual():
    assert usual(seen_twice(0.25), [0, 1]) == 0.0


def test_few_returns_say_nothing():
    part = seen_twice(0.25, num_nodes=4)
    assert 0 < 2 * 4 * 40 < MIN_USUAL_RETURNS
    assert usual(part, [0, 0]) == 0.0


def test_returns_that_are_not_confirmed_are_not_counted():
    parts = [0, 1]
    counts = []
    for is_confirmed in (True, False):
        part = seen_twice(0.25, is_confirmed=is_confirmed)
        nodes = np.repeat(parts, part[0].num_nodes // 2)
        two = TwoParts(*part, nodes, np.array(parts))
        check = check_geometry(two, QualityConfig(), JoinConfig(), ConfirmedReturns())
        counted = count_returns(two, QualityConfig(), ConfirmedReturns())
        assert (counted.on_wall, counted.on_floor) == (check.on_wall, check.on_floor)
        counts.append((check.on_floor > 0, check.on_wall))
    assert counts[0][0]
    assert not counts[1][0]
    assert counts[0][1] == counts[1][1] > 0


@pytest.mark.parametrize(("usual", "limit"), [(0.05, 0.06), (0.3, MAX_FLOOR_SHARE)])
def test_checks_state_how_much_floor_the_parts_allow(usual, limit, monkeypatch):
    monkeypatch.setattr("cartoloop.quality.joins._usual", lambda parts, quality: usual)
    part = seen_twice(0.25)
    nodes = np.repeat([0, 1], part[0].num_nodes // 2)
    lenient = JoinConfig(min_overlap=0.0, max_contradicted_share=1.0)
    check = check_geometry(
        TwoParts(*part, nodes, np.array([0, 1])), QualityConfig(), lenient, ConfirmedReturns()
    )
    assert check.floor_share == pytest.approx(0.25)
    assert check.usual_limit == pytest.approx(limit)
    assert "on floor of the other part" in check.fault
