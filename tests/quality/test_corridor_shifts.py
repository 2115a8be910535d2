# SPDX-License-Identifier: Apache-2.0
"""Visits that are displaced along a corridor are found by its doors, whatever its walls say."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cartoloop.global_slam.pose_graph import ClosureConstraints, PoseGraph
from cartoloop.quality.corridor_shifts import MIN_MEDIAN_M, corridor_runs, shifted_places
from cartoloop.quality.verdict import Kind, Severity
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.session import Session
from cartoloop.submaps.finished_grid import FinishedGrid

R = 0.05
HALF_WIDTH, DOORS = 1.0, (3.0, 4.1, 7.2, 9.0, 12.3, 15.1, 16.4)
LENGTH = 18.0
FREE, WALL = 10, 250
WALK = np.arange(2.0, 16.0, 0.25)


def outline(doors=DOORS):
    """Points of two walls with niches of 30 cm where the doors are."""
    points = []
    for side in (-1.0, 1.0):
        for x in np.arange(0.0, LENGTH, 0.04):
            in_door = side > 0 and any(door <= x <= door + 0.9 for door in doors)
            points.append((x, side * (HALF_WIDTH + 0.3 * in_door)))
        for door in doors if side > 0 else ():
            for depth in np.arange(0.0, 0.3, 0.04):
                points += [(door, HALF_WIDTH + depth), (door + 0.9, HALF_WIDTH + depth)]
    return np.array(points)


def grid(points):
    cells = np.zeros((80, 420), np.uint8)
    cells[15:66, 20:380] = FREE
    rows, cols = np.round((points[:, 1] + 2.0) / R).astype(int), np.round((points[:, 0] + 1.0) / R)
    cells[rows, cols.astype(int)] = WALL
    return FinishedGrid(cells, -1.0, -2.0, R)


def corridor(displaced, doors=DOORS, share=1.0):
    """A map whose scans were matched so far along the corridor from where they fit."""
    walls = outline(doors)
    graph, scans = PoseGraph(), []
    graph.add_submap((0.0, 0.0, 0.0))
    for number, x in enumerate(WALK):
        pose = (x + displaced * (number < share * len(WALK)), 0.0, 0.0)
        near = np.abs(walls[:, 0] - x) < 3.0
        scans.append(walls[near] - (x, 0.0))
        graph.add_node(pose)
    count = len(WALK)
    information = np.broadcast_to(np.diag((300.0, 5000.0, 1e5)), (count, 3, 3))
    rows = np.arange(count, dtype=np.int32)
    graph.add_loop_closures(
        ClosureConstraints(
            rows, np.zeros(count, int), np.arange(count), graph.node_poses, information
        )
    )
    content = SimpleNamespace(
        graph=graph,
        submap_grids=[grid(walls)],
        stamps=np.arange(count, dtype=float),
        node_scan_index=np.arange(count),
        sessions=(Session(),),
        numbers=np.zeros(count, dtype=np.int64),
    )
    return content, ScanPoints.of(scans)


@pytest.mark.parametrize("displaced", [-0.5, 0.4, 0.7])
def test_displaced_visits_are_found(displaced):
    content, scans = corridor(displaced)

    (place,) = shifted_places(content, scans)

    assert (place.kind, place.severity) == (Kind.CONTRADICTION, Severity.DOUBTFUL)
    assert f"along a corridor by {abs(displaced):.1f} m" in place.reason
    runs = corridor_runs(content.graph, content.numbers, content.submap_grids, scans)
    assert np.abs(runs.shift) == pytest.approx(abs(displaced), abs=0.06)
    assert np.unique(np.concatenate(runs.nodes)).tolist() == list(range(len(WALK)))


def test_visits_that_fit_are_left_alone():
    content, scans = corridor(0.0)

    assert shifted_places(content, scans) == []
    runs = corridor_runs(content.graph, content.numbers, content.submap_grids, scans)
    assert len(runs.shift) >= 4
    assert not runs.shift.any()


def test_small_displacements_are_left_alone():
    assert shifted_places(*corridor(MIN_MEDIAN_M - 0.1)) == []


def test_a_corridor_without_doors_says_nothing():
    content, scans = corridor(0.5, doors=())

    assert shifted_places(content, scans) == []


def test_maps_without_closures_say_nothing():
    content, scans = corridor(0.5)
    content.graph = PoseGraph()

    assert shifted_places(content, scans) == []


def test_sessions_are_looked_at_apart():
    content, scans = corridor(0.5)
    content.numbers[len(WALK) // 2 :] = 1

    runs = corridor_runs(content.graph, content.numbers, content.submap_grids, scans)

    assert all(np.ptp(content.numbers[nodes]) == 0 for nodes in runs.nodes)
