# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.config import Config
from cartoloop.global_slam.closure_status import Status
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.lifelong.trim import trimmed
from cartoloop.map_file.read import read_map
from cartoloop.map_file.write import map_bytes
from cartoloop.report import InputSummary, Report
from cartoloop.result import Result
from cartoloop.sensor.pose import relative_all
from cartoloop.session import Session
from cartoloop.submaps.finished_grid import FinishedGrid
from tests.global_slam.closures import add_to_graph, closure, record

R = 0.05
NODES_PER_SUBMAP, SCANS_PER_NODE = 3, 2


def grid(first_col, end_col):
    cells = np.zeros((30, 120), np.uint8)
    cells[:, first_col:end_col] = 20
    cells[4, first_col:end_col] = 240
    return FinishedGrid(cells, R / 2, R / 2, R)


def drive(graph, seen, y):
    """Add the submaps of a drive, each of some nodes, which are in the next one as well."""
    first, first_node = graph.num_submaps, graph.num_nodes
    graph.add_submaps([(0.0, 0.0, 0.0) for _ in seen])
    for number, (begin, end) in enumerate(seen):
        for step in range(NODES_PER_SUBMAP):
            x = R * (begin + (end - begin) * (step + 1) / (NODES_PER_SUBMAP + 1))
            node = graph.add_node((x, y, 0.0))
            for submap in (first + number, first + number + 1):
                if submap < first + len(seen):
                    place = graph.node_poses[node] - graph.submap_poses[submap]
                    graph.add_constraint(
                        ConstraintKind.INTRA_SUBMAP, submap, node, place, 1e4 * np.eye(3)
                    )
    return [grid(*one) for one in seen], first, first_node


def two_drives(second=((0, 40), (38, 75)), **report):
    """A map of two drives; the second sees the first two of the three submaps again."""
    graph = PoseGraph()
    one, *_ = drive(graph, [(0, 40), (35, 70), (65, 118)], y=1.0)
    two, first_submap, first_node = drive(graph, second, y=0.8)
    graph.fix_submap(0)
    pairs = [(first_submap, 1), (first_submap + 1, 5), (2, first_node + 4), (0, first_node)]
    found = [closure(3, 0, relative(graph, 3, 0))]
    closures = record(found=found, final=[closure(*pair, relative(graph, *pair)) for pair in pairs])
    add_to_graph(graph, closures)
    num_scans = SCANS_PER_NODE * graph.num_nodes
    node_scan_index = SCANS_PER_NODE * np.arange(graph.num_nodes)
    trajectory = np.repeat(graph.node_poses, SCANS_PER_NODE, axis=0)
    sessions = (
        Session("one"),
        Session(
            "two",
            first_scan=SCANS_PER_NODE * first_node,
            first_node=first_node,
            first_submap=first_submap,
        ),
    )
    return Result(
        np.arange(num_scans, dtype=float), trajectory, trajectory.copy(), graph, node_scan_index,
        [*one, *two], Config(), Report(InputSummary(scans=num_scans), extra=report),
        closures=closures, node_points=[np.full((2, 2), float(n)) for n in range(graph.num_nodes)],
        sessions=sessions,
    )  # fmt: skip


def relative(graph, submap, node):
    return relative_all(graph.submap_poses[submap][None], graph.node_poses[node][None])[0]


@pytest.fixture(scope="module")
def before():
    return two_drives(joins=[{"sessions": [[0], [1]], "joined": True}])


@pytest.fixture(scope="module")
def after(before):
    return trimmed(before)


def test_submaps_that_were_seen_again_are_removed(before, after):
    assert before.graph.num_submaps == 5
    assert after.graph.num_submaps == 3
    assert after.report.submaps == 3
    assert len(after.submap_grids) == 3
    assert after.report.extra["lifelong"]["removed_submaps"] == 2


def test_nodes_of_removed_submaps_alone_go_with_their_scans(before, after):
    # The nodes of the second submap were inserted into the third, too.
    assert after.report.extra["lifelong"]["removed_nodes"] == NODES_PER_SUBMAP
    assert after.graph.num_nodes == before.graph.num_nodes - NODES_PER_SUBMAP
    assert after.stamps.tolist() == before.stamps[SCANS_PER_NODE * NODES_PER_SUBMAP :].tolist()
    assert [points[0, 0] for points in after.node_points] == list(range(3, 15))
    assert after.report.input.scans == len(after.stamps)


def test_what_stays_keeps_its_poses_and_stamps(before, after):
    assert np.array_equal(after.graph.node_poses, before.graph.node_poses[3:])
    assert np.array_equal(after.graph.submap_poses, before.graph.submap_poses[2:])
    stamps = before.stamps[before.node_scan_index[3:]]
    assert np.array_equal(after.stamps[after.node_scan_index], stamps)


def test_sessions_begin_where_they_begin_now(after):
    one, two = after.sessions
    assert (one.first_scan, one.first_node, one.first_submap) == (0, 0, 0)
    assert (two.name, two.first_node, two.first_submap) == ("two", 6, 1)
    assert two.first_scan == SCANS_PER_NODE * 6


def test_closures_of_removed_ends_are_forgotten(before, after):
    assert before.graph.num_loop_closures == 4
    graph = after.graph
    rows = graph.closure_rows[graph.kinds == ConstraintKind.LOOP_CLOSURE]
    ends = list(zip(after.closures.submap[rows], after.closures.node[rows], strict=True))
    assert ends == [(2, 2), (0, 10)]  # (4, 5) and (2, 13) of before
    own = graph.kinds == ConstraintKind.LOOP_CLOSURE
    assert np.array_equal(graph.index_a[own], after.closures.submap[rows])
    assert np.array_equal(graph.index_b[own], after.closures.node[rows])
    assert np.all(after.closures.status[rows] == Status.FINAL)


def test_the_graph_holds_what_is_left_together(after):
    graph = after.graph
    connected = {0}
    vertices = set()
    while connected != vertices:
        vertices = set(connected)
        for kind, a, b in zip(graph.kinds, graph.index_a, graph.index_b, strict=True):
            first = a + graph.num_submaps if kind == ConstraintKind.NODE_TO_NODE else a
            if {first, b + graph.num_submaps} & connected:
                connected |= {first, b + graph.num_submaps}
    assert len(connected) == graph.num_submaps + graph.num_nodes
    assert tuple(graph.fixed_submaps) == (0,)


def test_a_trimmed_map_is_saved_and_read(after, tmp_path):
    path = tmp_path / "map.cartoloop"
    path.write_bytes(map_bytes(after))
    read = read_map(path)
    assert np.array_equal(read.graph.informations, after.graph.informations)
    assert [session.first_node for session in read.sessions] == [0, 6]
    assert len(read.closures) == len(after.closures)


def test_the_same_map_yields_the_same_bytes(before, after):
    assert map_bytes(trimmed(before)) == map_bytes(after)


def test_trimming_again_changes_nothing(after):
    again = trimmed(after)
    assert again.report.extra["lifelong"]["removed_submaps"] == 0
    assert np.array_equal(again.graph.node_poses, after.graph.node_poses)
    assert again.graph.num_constraints == after.graph.num_constraints


def test_a_session_that_was_seen_again_as_a_whole_is_gone():
    whole = two_drives(
        second=((0, 60), (58, 118)), joins=[{"sessions": [[0], [1]], "joined": True}]
    )
    left = trimmed(whole)
    assert [session.name for session in left.sessions] == ["two"]
    assert left.sessions[0].first_node == 0
    assert left.report.extra["joins"] == []
    assert left.graph.num_nodes == 6
    assert tuple(left.graph.fixed_submaps) == (0,)


def test_a_map_of_one_session_stays_as_it_is(before):
    alone = replace(before, sessions=before.sessions[:1])
    assert trimmed(alone) is alone


def test_parts_do_not_cover_each_other(before):
    one, two = before.sessions
    apart = replace(before, sessions=(one, replace(two, part=1)))
    assert trimmed(apart) is apart


def test_a_session_with_a_gap_becomes_two_of_the_same_name():
    """The second drive sees only the middle of the first again."""
    graph = PoseGraph()
    seen = [(0, 30), (20, 50), (40, 70), (60, 90), (85, 118)]
    one, *_ = drive(graph, seen, y=1.0)
    two, first_submap, first_node = drive(graph, [(15, 60), (50, 95)], y=0.8)
    graph.fix_submap(0)
    for submap, node in ((first_submap, 3), (first_submap, 5), (first_submap + 1, 9)):
        graph.add_constraint(
            ConstraintKind.LOOP_CLOSURE, submap, node, relative(graph, submap, node), np.eye(3)
        )
    num_scans = SCANS_PER_NODE * graph.num_nodes
    poses = np.repeat(graph.node_poses, SCANS_PER_NODE, axis=0)
    result = replace(
        two_drives(joins=[{"sessions": [[0], [1]], "joined": True}]),
        stamps=np.arange(num_scans, dtype=float),
        trajectory=poses,
        local_trajectory=poses,
        graph=graph,
        node_scan_index=SCANS_PER_NODE * np.arange(graph.num_nodes),
        submap_grids=[*one, *two],
        closures=record(),
        node_points=[np.zeros((2, 2))] * graph.num_nodes,
        sessions=(
            Session("one"),
            Session(
                "two",
                first_scan=SCANS_PER_NODE * first_node,
                first_node=first_node,
                first_submap=first_submap,
            ),
        ),
    )
    left = trimmed(result)
    assert [session.name for session in left.sessions] == ["one", "one", "two"]
    assert left.report.extra["joins"][0]["sessions"] == [[0, 1], [2]]
    begins = [s.stamp for s in left.sessions]
    firsts = [left.stamps[session.first_scan] for session in left.sessions]
    assert begins == firsts
    assert [session.first_submap for session in left.sessions] == [0, 1, 2]
