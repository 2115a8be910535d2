# SPDX-License-Identifier: Apache-2.0
"""What pages ask of a map that grows no more: facts, all closures, the poses before them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.map_output.colours import DARK, LIGHT
from cartoloop.map_output.map_facts import map_facts
from cartoloop.sensor.pose import Pose, compose_all, relative_all, transform_points
from cartoloop.viewer.closure_details import closure_details
from cartoloop.viewer.feed import constraints_of, poses_before, rejected_closures
from cartoloop.viewer.protocol import MessageType
from cartoloop.viewer.view import serve_result
from tests.viewer.page_twin import ask, join, look


def test_the_facts_of_a_finished_map_are_sent(page, result):
    facts, sent = map_facts(result), page.json[MessageType.FACTS]

    assert sent["described"] == [list(pair) for pair in facts.described()]
    assert sent["extent"]["left"] == facts.extent.left
    assert (sent["verdict"], sent["finished"]) == (result.quality.verdict, True)


def test_a_stopped_run_is_served_as_stopped(result):
    report = replace(result.report, finished=False)
    server = serve_result(replace(result, report=report), "ring", port=0)
    try:
        with join(server.url) as connection:
            page = look(connection)
    finally:
        server.close()

    assert page.readings["state"] == "stopped"
    assert page.playback["can_scrub"] is True
    assert page.json[MessageType.FACTS]["finished"] is False


def test_pages_get_the_colours_of_maps(page):
    assert page.hello["colours"] == {
        name: {key: list(colour) for key, colour in colours._asdict().items()}
        for name, colours in (("light", LIGHT), ("dark", DARK))
    }


def test_all_closures_are_listed_with_what_is_known(connection, page, result):
    kind, listed = ask(connection, page, type="closures", id=4)

    graph, rejected = result.graph, rejected_closures(result.closures)
    in_graph = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    first = graph.num_constraints
    assert (kind, listed["id"]) == (MessageType.CLOSURES, 4)
    assert listed["constraint"] == [*in_graph, *range(first, first + len(rejected.kinds))]
    rows = np.concatenate((graph.closure_rows[in_graph], rejected.closures))
    scores = np.array([np.nan if s is None else s for s in listed["score"]])
    np.testing.assert_allclose(scores, result.closures.score[rows], atol=0.0006)
    words = [listed["reasons"][str(code)] for code in listed["reason"]]
    assert words == [Reason(code).text for code in result.closures.reason[rows].tolist()]


def test_poses_before_loop_closure_are_those_of_local_slam(connection, page, result):
    kind, before = ask(connection, page, type="before", id=9)

    graph = result.graph
    local = result.local_trajectory[result.node_scan_index]
    assert kind == MessageType.BEFORE
    np.testing.assert_allclose(before["nodes"][0], graph.node_poses[0], atol=1e-5)
    steps = relative_all(before["nodes"][:-1].astype(float), before["nodes"][1:].astype(float))
    np.testing.assert_allclose(steps, relative_all(local[:-1], local[1:]), atol=1e-4)
    own = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
    expected = compose_all(before["submaps"][graph.index_a[own]], graph.relative_poses[own])
    np.testing.assert_allclose(expected, before["nodes"][graph.index_b[own]], atol=2e-3)
    moved = np.hypot(*(before["nodes"][:, :2] - graph.node_poses[:, :2]).T)
    assert moved.max() > 0.005  # the loop was closed


def test_an_empty_map_has_no_poses_before(result):
    graph = type(result.graph)()
    empty = replace(result, graph=graph, node_scan_index=np.zeros(0, np.int64))

    assert [len(poses) for poses in poses_before(empty)] == [0, 0]


def test_the_card_shows_a_scan_that_saw_the_same(result):
    """Not the nearest in position, which may have looked into another direction."""
    graph, points = result.graph, list(result.node_points)
    rows = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    row = int(rows[len(rows) // 2])  # the first ones overlap little
    submap, node = int(graph.index_a[row]), int(graph.index_b[row])
    measured = Pose(*graph.relative_poses[row].tolist())
    own = np.flatnonzero((graph.kinds == ConstraintKind.INTRA_SUBMAP) & (graph.index_a == submap))
    far = graph.relative_poses[own, :2] - np.array(measured[:2])
    nearest = int(graph.index_b[own[np.argmin(np.hypot(*far.T))]])
    points[nearest] = transform_points(Pose(100.0, 0.0, 0.0), points[nearest])  # sees nothing of it

    details = closure_details(
        row, constraints_of(graph), graph.submap_poses, graph.node_poses, points, result.closures
    )

    assert details["other_node"] not in (nearest, node)
    assert details["overlap"] > 0.5
    points = [np.full((5, 2), 1e3 * number) for number in range(len(points))]
    details = closure_details(
        row, constraints_of(graph), graph.submap_poses, graph.node_poses, points, result.closures
    )
    assert details["overlap"] == 0.0
