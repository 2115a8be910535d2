# SPDX-License-Identifier: Apache-2.0
"""Pages edit a map where they may: it is saved, and all pages get the new poses."""

from __future__ import annotations

import json
import shutil
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

import cartoloop
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.session import Session
from cartoloop.viewer.beside import GAP_M, beside
from cartoloop.viewer.protocol import MessageType
from cartoloop.viewer.view import serve_result
from tests.viewer.page_twin import join, look


@pytest.fixture
def folder(result, ring_result, shared_files, tmp_path):
    saved = shared_files.path("ring_saved", ring_result.save)
    return shutil.copytree(saved, tmp_path / "ring")


@pytest.fixture
def edited(folder):
    """A server of a map that pages may edit, and two pages that look at it."""
    editor = cartoloop.edit(folder)
    server = serve_result(editor.map, "ring", port=0, editor=editor)
    with ExitStack() as stack:
        stack.callback(server.close)
        connections = [stack.enter_context(join(server.url)) for _ in range(2)]
        yield server, [(connection, look(connection)) for connection in connections]
    assert server.failure is None


def ask(connection, page, **request):
    page.answers.clear()
    connection.send(json.dumps(request))
    look(connection, page, lambda page: page.answers)
    return page.answers[0]


def closure_of(result):
    graph = result.graph
    row = int(np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)[-1])
    return int(graph.index_a[row]), int(graph.index_b[row])


def edits_of(page):
    return page.json[MessageType.EDITS]


def test_closures_are_dropped_where_scans_are_forgotten(folder, result):
    stamps = result.stamps
    with cartoloop.edit(folder) as editor:
        editor.forget_time(stamps[len(stamps) // 2], stamps[len(stamps) // 2 + 5])
    editor = cartoloop.edit(folder)
    server = serve_result(editor.map, "ring", port=0, editor=editor)
    with ExitStack() as stack:
        stack.callback(server.close)
        connection = stack.enter_context(join(server.url))
        page = look(connection)
        submap, node = closure_of(editor.map)
        _, answer = ask(connection, page, type="drop_closure", id=1, submap=submap, node=node)
    assert "drop closure" in answer["text"]


def test_a_closure_is_dropped_and_that_is_undone(edited, folder, result):
    _, ((connection, page), (other, other_page)) = edited
    submap, node = closure_of(result)
    before = {name: (folder / name).read_bytes() for name in ("trajectory.tum", "graph.g2o")}
    kind, answer = ask(connection, page, type="drop_closure", id=3, submap=submap, node=node)

    assert (kind, answer["id"]) == (MessageType.EDITED, 3)
    assert "poses moved by at most" in answer["text"]
    look(other, other_page, lambda page: edits_of(page)["edits"])
    assert edits_of(other_page)["edits"][0]["is_undone"] is False
    loaded = cartoloop.load(folder)
    assert loaded.graph.num_loop_closures == result.graph.num_loop_closures - 1
    np.testing.assert_allclose(other_page.tables["nodes"], loaded.graph.node_poses, atol=1e-4)
    kinds = other_page.tables["constraints"][:, 5]
    assert np.count_nonzero(kinds == ConstraintKind.LOOP_CLOSURE) == loaded.graph.num_loop_closures

    assert ask(connection, page, type="undo_edit", id=4, edit=0)[0] == MessageType.EDITED
    assert {name: (folder / name).read_bytes() for name in before} == before


def test_the_card_of_a_dropped_closure_names_its_edit(edited, result):
    _, ((connection, page), _) = edited
    submap, node = closure_of(result)
    ask(connection, page, type="drop_closure", id=1, submap=submap, node=node)
    look(connection, page, lambda page: edits_of(page)["edits"])
    rows = page.tables["constraints"]
    [row] = np.flatnonzero((rows[:, 0] == submap) & (rows[:, 1] == node))
    details = ask(connection, page, type="closure", id=2, constraint=int(row))[1]

    assert (details["status"], details["edit"]) == ("removed", 0)


def test_what_cannot_be_edited_is_a_problem_and_changes_nothing(edited, folder, result):
    _, ((connection, page), _) = edited
    before = (folder / "map.cartoloop").read_bytes()
    for request in (
        {"type": "drop_closure", "submap": 10**6, "node": 0},
        {"type": "undo_edit", "edit": 7},
        {"type": "redo_edit", "edit": 0},
    ):
        kind, problem = ask(connection, page, id=5, **request)
        assert kind == MessageType.PROBLEM
        assert "\n" not in problem["text"]

    assert (folder / "map.cartoloop").read_bytes() == before


def test_edits_of_cells_are_left_to_the_command_line(folder):
    with cartoloop.edit(folder) as editor:
        editor.forget_area(-1.0, -1.0, 1.0, 1.0)
    editor = cartoloop.edit(folder)
    server = serve_result(editor.map, "ring", port=0, editor=editor)
    try:
        with join(server.url) as connection:
            page = look(connection)
            kind, problem = ask(connection, page, type="undo_edit", id=1, edit=0)
    finally:
        server.close()

    assert kind == MessageType.PROBLEM
    assert "use 'cartoloop edit'" in problem["text"]
    assert not cartoloop.load(folder).edits[0].is_undone


def test_the_change_of_another_program_stops_an_edit(edited, folder, result):
    _, ((connection, page), _) = edited
    with cartoloop.edit(folder) as editor:
        editor.align()
    submap, node = closure_of(result)
    kind, problem = ask(connection, page, type="drop_closure", id=1, submap=submap, node=node)

    assert kind == MessageType.PROBLEM
    assert "changed by another program" in problem["text"]
    assert [edit.kind for edit in cartoloop.load(folder).edits] == ["align"]


def test_a_view_that_does_not_edit_refuses(server, result):
    with join(server.url) as connection:
        page = look(connection)
        submap, node = closure_of(result)
        kind, problem = ask(connection, page, type="drop_closure", id=1, submap=submap, node=node)

    assert MessageType.EDITS not in page.json
    assert kind == MessageType.PROBLEM
    assert "--edit" in problem["text"]


def in_two_parts(result):
    first = result.graph.num_submaps // 2
    graph = result.graph
    own = (graph.index_a == first) & (graph.kinds == ConstraintKind.INTRA_SUBMAP)
    node = int(graph.index_b[own].min())
    scan = int(result.node_scan_index[node])
    sessions = (
        Session("morning"),
        Session("evening", first_scan=scan, first_node=node, first_submap=first, part=1),
    )
    return replace(result, sessions=sessions)


def test_parts_that_are_apart_lie_beside_the_map(result):
    apart = in_two_parts(result)
    placed = beside(apart)
    second = apart.submap_parts == 1

    assert np.array_equal(placed.submap_poses[~second], result.graph.submap_poses[~second])
    moved = placed.submap_poses[second] - result.graph.submap_poses[second]
    assert np.ptp(moved, axis=0).max() < 1e-9
    nodes = placed.node_poses[apart.node_parts == 1]
    assert nodes[:, 0].min() > placed.node_poses[apart.node_parts == 0, 0].max() + GAP_M


def test_pages_get_the_sessions_of_a_map(result):
    server = serve_result(in_two_parts(result), "ring", port=0)
    try:
        with join(server.url) as connection:
            page = look(connection)
    finally:
        server.close()
    first, second = page.json[MessageType.SESSIONS]["sessions"]

    assert (first["name"], first["part"], first["first_node"]) == ("morning", 0, 0)
    assert (second["name"], second["part"]) == ("evening", 1)
