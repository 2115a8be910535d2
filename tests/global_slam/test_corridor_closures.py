# SPDX-License-Identifier: Apache-2.0
"""Matches that agree on a corridor, and closures that leave the place along it open."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.global_slam.corridor_closures import (
    CorridorClosures,
    Lines,
    on_one_line,
    placed_along,
    widened,
)
from cartoloop.global_slam.join_evidence import Nearby
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.sensor.pose import compose_all
from tests.global_slam.closures import requests, search_matches

DIRECTION = math.radians(85.0)
SLIDES = np.array([0.0, 4.6, -3.7, 1.2, 7.9, -7.0])


def lines(slides=SLIDES, across=0.0, turns=0.0, scatter_deg=0.0, nodes=None):
    """Return where nodes place an end: slid along a corridor, and off it, shape (n,) each."""
    count = len(slides)
    axis = np.array((math.cos(DIRECTION), math.sin(DIRECTION)))
    side = np.array((-axis[1], axis[0]))
    offsets = np.outer(slides, axis) + np.outer(np.broadcast_to(across, count), side)
    places = offsets + np.array((20.0, 5.0))
    headings = 0.3 + np.broadcast_to(turns, count)
    numbers = range(count) if nodes is None else nodes
    nearby = Nearby(
        requests(*((0, node) for node in numbers))._replace(linear_window=np.full(count, 17.0)),
        search_matches(np.full(count, -1)),
        np.full(count, 0.4),
    )
    scatter = np.radians(scatter_deg) * (-1.0) ** np.arange(count)
    return Lines(nearby, np.column_stack((places, headings)), DIRECTION + scatter)


PATH = np.linspace(0.0, 3.0, len(SLIDES))


def test_matches_slid_along_a_corridor_agree():
    found = on_one_line(lines(scatter_deg=8.0), PATH)
    assert found is not None
    chosen, direction = found
    assert chosen.tolist() == list(range(len(SLIDES)))
    assert abs(math.sin(direction - DIRECTION)) < 1e-6


@pytest.mark.parametrize(
    "case",
    [
        {"across": np.array([0.0, 4.0, -4.0, 8.0, -8.0, 12.0])},
        {"turns": np.radians([0.0, 5.0, -5.0, 10.0, -10.0, 15.0])},
        {"across": np.array([0.0, 0.0, 0.0, 6.0, 6.0, 6.0])},
        {"nodes": [0, 1, 2, 0, 1, 2]},
    ],
    ids=["several lines", "several headings", "two corridors", "few nodes"],
)
def test_matches_in_other_places_do_not(case):
    assert on_one_line(lines(**case), PATH) is None


def test_a_robot_that_stands_shows_no_line():
    assert on_one_line(lines(), 0.1 * PATH) is None


def test_no_matches_are_no_line():
    assert on_one_line(lines(np.zeros(0)), np.zeros(0)) is None


def test_one_wrong_match_is_left_out():
    found = on_one_line(lines(across=np.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0])), PATH)
    assert found is not None
    assert found[0].tolist() == [0, 1, 3, 4, 5]


def graph_at(submap, nodes):
    graph = PoseGraph()
    graph.add_submap(submap)
    graph.add_nodes(nodes)
    return graph


def held(direction=DIRECTION):
    graph = graph_at((3.0, 1.0, 0.4), [(0.0, 0.0, 0.0)] * len(SLIDES))
    return graph, widened(lines(), np.arange(len(SLIDES)), graph, direction)


def sigma(information, angle):
    axis = np.array((math.cos(angle), math.sin(angle), 0.0))
    return math.sqrt(axis @ np.linalg.inv(information) @ axis)


def test_closures_leave_the_place_along_open():
    graph, closures = held()
    before = lines().nearby.matches.information[0]
    (after, *_) = closures.nearby.matches.information
    angle = DIRECTION - graph.submap_poses[0, 2]
    assert closures.direction(graph) == pytest.approx(DIRECTION)
    assert sigma(after, angle) == pytest.approx(17.0, rel=0.01)
    assert sigma(after, angle + math.pi / 2) == pytest.approx(
        sigma(before, angle + math.pi / 2), rel=0.2
    )
    assert np.linalg.eigvalsh(after).min() > 0.0


def test_bare_walls_may_say_nothing_at_all_along_them():
    flat = np.diag((0.0, 400.0, 900.0))
    bare = lines()
    nearby = bare.nearby._replace(
        matches=bare.nearby.matches._replace(information=np.array([flat] * len(SLIDES)))
    )
    graph = graph_at((0.0, 0.0, 0.0), [(0.0, 0.0, 0.0)] * len(SLIDES))
    closures = widened(bare._replace(nearby=nearby), np.arange(len(SLIDES)), graph, 0.0)
    assert sigma(closures.nearby.matches.information[0], 0.0) == pytest.approx(17.0, rel=0.01)
    assert sigma(closures.nearby.matches.information[0], math.pi / 2) == pytest.approx(0.05)


def test_closures_follow_the_graph_along_alone():
    _, closures = held()
    angle = closures.angle[0]
    axis, side = (np.array((math.cos(a), math.sin(a))) for a in (angle, angle + math.pi / 2))
    measured = closures.nearby.matches.tf_submap_node[0, :2]
    adjusted = graph_at((0.0, 0.0, 0.0), [(2.0, -1.0, 0.1)] * len(SLIDES))
    moved = placed_along(closures, adjusted, 0.5, 0.25).matches
    assert (moved.tf_submap_node[0, :2] - (2.0, -1.0)) @ axis == pytest.approx(0.5)
    assert (moved.tf_submap_node[0, :2] - measured) @ side == pytest.approx(0.0, abs=1e-9)
    assert sigma(moved.information[0], angle) == pytest.approx(0.25 / math.sqrt(12.0), rel=0.01)


def test_matches_at_the_place_stay_as_measured():
    graph, closures = held()
    poses = closures.nearby.matches.tf_submap_node.copy()
    graph.node_poses[:] = compose_all(graph.submap_poses[0], poses)
    placed = placed_along(closures, graph, 0.1, 0.25)
    np.testing.assert_allclose(placed.matches.tf_submap_node, poses)
    np.testing.assert_allclose(placed.matches.information, lines().nearby.matches.information)


def test_an_open_place_stays_open_in_other_frames():
    graph, closures = held()
    graph.submap_poses[0] = (7.0, -2.0, 0.5)
    assert isinstance(closures, CorridorClosures)
    assert closures.direction(graph) == pytest.approx(DIRECTION + 0.1)
