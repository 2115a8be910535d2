# SPDX-License-Identifier: Apache-2.0
"""A page that looks at a finished map: it sees what was exported, and gets what it asks for."""

from __future__ import annotations

import io
import json
from contextlib import closing

import numpy as np
import pytest
from PIL import Image

from cartoloop.config_file import load_config
from cartoloop.errors import OutputError
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.map_output.picture import palette
from cartoloop.mapper import Mapper
from cartoloop.viewer.feed import rejected_closures
from cartoloop.viewer.protocol import REJECTED, MessageType
from cartoloop.viewer.view import serve_result
from tests.viewer.page_twin import ask, join, look


def test_the_page_draws_the_exported_map(page, result):
    exported = compose_map(
        result.submap_grids, result.graph.submap_poses, result.config.local_slam.submaps
    )
    level = np.where(exported.probability < 0.0, 256, np.rint(exported.probability * 255.0))
    expected = palette()[level.astype(int)].astype(int)
    lower = np.rint(np.array((exported.origin_x, exported.origin_y)) / exported.resolution)

    shown, between = page.compose(lower, exported.probability.shape)

    difference = np.abs(shown.astype(int) - expected).max(axis=2)
    assert difference[~between].max() <= 2
    assert (difference > 2).mean() < 0.005  # at the rim of the first submap, which is not turned
    assert (difference == 0).mean() > 0.99
    assert len(np.unique(expected[..., 0])) > 50


def test_parts_come_in_the_documented_order(page, result):
    graph = result.graph
    assert page.order[0] == MessageType.HELLO
    assert page.order[-1] == MessageType.COMPLETE
    assert page.order.count(MessageType.SUBMAP) == graph.num_submaps > 3
    assert [kind for kind in dict.fromkeys(page.order) if kind != MessageType.LATEST_CLOSURE] == [
        MessageType.HELLO, MessageType.PLAYBACK, MessageType.READINGS, MessageType.SUBMAP_POSES,
        MessageType.NODES, MessageType.NODE_TIMES, MessageType.SUBMAP_PREVIEW, MessageType.SUBMAP,
        MessageType.CONSTRAINTS, MessageType.QUALITY, MessageType.FACTS, MessageType.SESSIONS,
        MessageType.SCAN, MessageType.COMPLETE,
    ]  # fmt: skip
    assert (page.hello["protocol"], page.hello["mode"], page.hello["name"]) == (
        3, "finished", "ring",
    )  # fmt: skip
    assert np.array_equal(page.tables["submap_poses"], graph.submap_poses)
    assert np.array_equal(page.tables["nodes"], graph.node_poses)
    assert np.array_equal(page.tables["node_times"], result.stamps[result.node_scan_index])
    counts, found = result.closures.counts(), result.closures.found
    rejected = page.tables["constraints"][graph.num_constraints :]
    assert counts[Status.CONTRADICTED] <= len(rejected) < len(found) + counts[Status.CONTRADICTED]
    assert np.all(rejected[:, 5] == REJECTED)
    constraints = page.tables["constraints"][: graph.num_constraints]
    assert np.array_equal(constraints[:, 0], graph.index_a)
    assert np.array_equal(constraints[:, 1], graph.index_b)
    assert np.allclose(constraints[:, 2:5], graph.relative_poses, atol=1e-5)
    assert np.array_equal(constraints[:, 5], graph.kinds)
    assert page.readings["state"] == "finished"
    assert page.readings["nodes"] == graph.num_nodes
    assert page.readings["loop_closures"] == result.report.constraints.loop_closure > 0
    assert page.playback == {
        "paused": False, "speed": None, "can_pause": False, "can_set_speed": False,
        "can_scrub": True,
    }  # fmt: skip


def test_details_of_a_closure(connection, page, result):
    row = int(np.flatnonzero(result.graph.kinds == 1)[0])

    kind, closure = ask(connection, page, type="closure", id=5, constraint=row)

    graph = result.graph
    assert (kind, closure["id"], closure["constraint"]) == (MessageType.CLOSURE, 5, row)
    assert (closure["submap"], closure["node"]) == (graph.index_a[row], graph.index_b[row])
    score = result.closures.score[graph.closure_rows[row]]
    assert closure["score"] == (None if np.isnan(score) else pytest.approx(score, abs=1e-6))
    assert (closure["status"], closure["reason"]) == ("final", "fits")
    assert 0.0 < closure["fit_residual"] < 1.0
    assert closure["residual_m"] < 0.2
    assert closure["residual_deg"] < 1.0
    assert len(closure["points"]) == len(result.node_points[closure["node"]]) > 20
    assert len(closure["other_points"]) > 20
    # laid over each other, both scans show the same walls
    ours = place(closure["tf_submap_node"], closure["points"])
    theirs = place(closure["tf_submap_other"], closure["other_points"])
    distance = np.linalg.norm(ours[:, None] - theirs[None], axis=2).min(axis=1)
    assert np.median(distance) < 0.5


@pytest.fixture(scope="module")
def strict_result(ring_events):
    """The ring, of whose closures the last pass rejects some."""
    strict = ("global_slam.constraint_search.max_refined_residual=0.35",)
    mapper = Mapper(load_config(None, strict).config)
    for event in ring_events:
        mapper.add(event)
    return mapper.finish()


def test_card_says_why_a_closure_was_rejected(strict_result):
    closures, first = strict_result.closures, strict_result.graph.num_constraints
    rows = rejected_closures(closures).closures
    assert len(rows) > 0
    server = serve_result(strict_result, "ring", port=0)
    with closing(server), join(server.url) as connection:
        page = look(connection)
        answers = [
            ask(connection, page, type="closure", id=number, constraint=first + number)[1]
            for number in range(len(rows))
        ]
    for closure, row in zip(answers, rows.tolist(), strict=True):
        assert (closure["submap"], closure["node"]) == (closures.submap[row], closures.node[row])
        assert closure["status"] == Status(closures.status[row]).text
        assert closure["status"] in ("poor_fit", "moved_too_far", "contradicted")
        assert closure["reason"] == Reason(closures.reason[row]).text != ""
        if row < closures.num_requested:
            assert closure["window"]["linear_m"] == closures.linear_window[row]
            assert closure["score"] is None or closure["score"] >= closure["min_score"] > 0.0


def test_points_of_a_node(connection, page, result):
    kind, scan = ask(connection, page, type="node_scan", id=6, node=3)

    assert (kind, scan["id"], scan["number"]) == (MessageType.NODE_SCAN, 6, 3)
    assert scan["time"] == result.stamps[result.node_scan_index[3]]
    assert np.allclose(scan["pose"], result.graph.node_poses[3])
    assert np.allclose(scan["points"], result.node_points[3], atol=1e-5)


def test_picture(connection, page):
    kind, answer = ask(connection, page, type="picture", id=7)

    assert (kind, answer["id"]) == (MessageType.PICTURE, 7)
    with Image.open(io.BytesIO(answer["png"])) as picture:
        assert picture.format == "PNG"
        assert min(picture.size) > 400


def test_the_same_picture_is_drawn_once(connection, page, monkeypatch):
    first = ask(connection, page, type="picture", id=1)[1]["png"]
    monkeypatch.setattr("cartoloop.viewer.pictures.picture_png", None)
    monkeypatch.setattr("cartoloop.viewer.pictures._MIN_AGE_S", 0.0)

    assert ask(connection, page, type="picture", id=2)[1]["png"] == first


def test_a_picture_that_cannot_be_drawn_is_refused_each_time(result, monkeypatch):
    def fail(_):
        raise OutputError("the map is too large")

    monkeypatch.setattr("cartoloop.viewer.pictures.picture_png", fail)
    server = serve_result(result, "ring", port=0)
    try:
        with join(server.url) as connection:
            page = look(connection)
            for number in (1, 2):
                kind, answer = ask(connection, page, type="picture", id=number)
                assert kind == MessageType.PROBLEM
                assert answer == {"id": number, "text": "the map is too large"}
    finally:
        server.close()


def test_answers_name_their_requests(connection, page):
    page.answers.clear()
    for number in range(8):
        connection.send(json.dumps({"type": "node_scan", "id": 100 + number, "node": 7 - number}))
    connection.send(json.dumps({"type": "node_scan", "id": 2**53 - 1, "node": 10**9}))
    connection.send(json.dumps({"type": "picture", "id": 2**53 - 2}))
    look(connection, page, lambda page: len(page.answers) == 10)

    scans = [answer for kind, answer in page.answers if kind == MessageType.NODE_SCAN]
    assert [(scan["id"], scan["number"]) for scan in scans] == [(100 + n, 7 - n) for n in range(8)]
    rest = [(kind, answer["id"]) for kind, answer in page.answers[8:]]
    assert rest == [(MessageType.PROBLEM, 2**53 - 1), (MessageType.PICTURE, 2**53 - 2)]


def test_ping(connection, page):
    assert ask(connection, page, type="ping", id=9) == (MessageType.PONG, {"id": 9})


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        ({"type": "closure", "constraint": 0}, "constraint 0 is no loop closure"),
        ({"type": "closure", "constraint": 10**9}, "is no loop closure"),
        ({"type": "node_scan", "node": 10**9}, "there is no node"),
    ],
)
def test_requests_for_missing_things_are_refused(connection, page, request_, why):
    kind, problem = ask(connection, page, id=8, **request_)

    assert (kind, problem["id"]) == (MessageType.PROBLEM, 8)
    assert why in problem["text"]


def test_playback_requests_do_nothing_to_a_finished_map(connection, page):
    connection.send('{"type": "pause"}')

    assert ask(connection, page, type="ping", id=1)[0] == MessageType.PONG
    assert page.playback["paused"] is False


def test_joining_again_brings_the_same_state(server, page):
    for _ in range(3):
        with join(server.url) as connection:
            again = look(connection)
        assert again.hello["session"] == page.hello["session"]
        assert again.submaps.keys() == page.submaps.keys()
        assert all(
            np.array_equal(texture["cells"], page.submaps[submap]["cells"])
            for submap, texture in again.submaps.items()
        )


def place(pose, points):
    x, y, theta = pose
    points = np.array(points)
    rotation = np.array([(np.cos(theta), -np.sin(theta)), (np.sin(theta), np.cos(theta))])
    return points @ rotation.T + (x, y)
