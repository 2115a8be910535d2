# SPDX-License-Identifier: Apache-2.0
"""Trajectories and graphs as text."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.g2o import read_g2o
from cartoloop.evaluation.trajectories import read_tum
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.map_output.text_files import format_stamp, g2o_text, tum_text
from cartoloop.sensor.pose import Pose, relative, wrap_angle


def random_graph(seed=0):
    rng = np.random.default_rng(seed)
    graph = PoseGraph()
    graph.add_nodes(rng.normal(size=(5, 3)))
    graph.add_submaps(rng.normal(size=(2, 3)))
    graph.fix_submap(0)
    root = rng.normal(size=(6, 3, 3))
    graph.add_constraints(
        [ConstraintKind.INTRA_SUBMAP] * 3
        + [ConstraintKind.LOOP_CLOSURE] * 2
        + [ConstraintKind.NODE_TO_NODE],
        [0, 0, 1, 1, 0, 2],
        [0, 1, 2, 3, 4, 3],
        rng.normal(size=(6, 3)),
        root @ root.transpose(0, 2, 1),
    )
    return graph


def parse_g2o(text):
    vertices, edges, fixed = {}, [], []
    for line in text.splitlines():
        tag, *words = line.split()
        if tag == "VERTEX_SE2":
            vertices[int(words[0])] = Pose(*map(float, words[1:]))
        elif tag == "EDGE_SE2":
            values = list(map(float, words[2:]))
            information = np.zeros((3, 3))
            information[np.triu_indices(3)] = values[3:]
            information = information + np.triu(information, 1).T
            edges.append((int(words[0]), int(words[1]), Pose(*values[:3]), information))
        elif tag == "FIX":
            fixed += map(int, words)
        else:
            assert tag == "#"
    return vertices, edges, fixed


def test_stamps_read_back_exactly_as_recorded(tmp_path):
    stamps = np.array([976052905.167303, 976052904.9, 0.1 + 0.2, 1e-7, 1134864645.90321, 5.0])
    (tmp_path / "t.tum").write_text(tum_text(stamps, np.zeros((6, 3))))

    assert read_tum(tmp_path / "t.tum").stamps.tolist() == stamps.tolist()


@given(st.floats(0, 1e12))
def test_any_stamp_reads_back_exactly(stamp):
    text = format_stamp(stamp)

    assert float(text) == stamp
    assert "e" not in text
    assert len(text.partition(".")[2]) >= 6


def test_poses_read_back_to_a_nanometre(tmp_path):
    poses = np.array([[1.23456789012, -20.5, 3.1], [0.0, -0.0, -3.1], [5.0, 6.0, math.pi]])
    (tmp_path / "t.tum").write_text(tum_text(np.arange(3.0), poses))

    reread = read_tum(tmp_path / "t.tum").poses

    assert reread[:2] == pytest.approx(poses[:2], abs=2e-9)
    assert abs(wrap_angle(reread[2, 2] - math.pi)) < 4e-9


def test_lines_are_tum():
    lines = tum_text(np.array([12.5]), np.array([[1.0, -0.0, math.pi / 2]])).splitlines()

    assert lines[0].startswith("#")
    assert lines[1] == "12.500000 1.000000000 0.000000000 0 0 0 0.707106781 0.707106781"


def test_g2o_holds_nodes_then_submaps_and_fixed_vertices():
    graph = random_graph()

    text = g2o_text(graph)
    vertices, edges, fixed = parse_g2o(text)

    assert text.startswith("# nodes have the ids 0 to 4, submaps those from 5 on\n")
    assert list(vertices) == list(range(7))
    assert vertices[3] == tuple(graph.node_poses[3])
    assert vertices[6] == tuple(graph.submap_poses[1])
    assert fixed == [5]
    assert [edge[:2] for edge in edges] == [(5, 0), (5, 1), (6, 2), (6, 3), (5, 4), (2, 3)]
    assert edges[4][2] == tuple(graph.relative_poses[4])


def test_g2o_has_the_cost_that_the_paper_defines():
    graph = random_graph()
    vertices, edges, _ = parse_g2o(g2o_text(graph))

    for k, (a, b, measured, information) in enumerate(edges):
        # eq. (5): the difference of relative poses, in the frame of a
        estimated = relative(vertices[a], vertices[b])
        error = np.array(estimated) - np.array(measured)
        error[2] = wrap_angle(error[2])
        paper = error @ graph.informations[k] @ error
        # g2o: the estimated as seen from the measured b
        error_g2o = np.array(relative(measured, estimated))
        assert error_g2o @ information @ error_g2o == pytest.approx(paper, rel=1e-9)


def test_g2o_reads_back_as_the_same_graph(tmp_path):
    graph = random_graph()
    (tmp_path / "graph.g2o").write_text(g2o_text(graph))

    reread = read_g2o(tmp_path / "graph.g2o")

    assert reread.node_poses.tolist() == [*graph.node_poses.tolist(), *graph.submap_poses.tolist()]
    assert reread.relative_poses.tolist() == graph.relative_poses.tolist()
    assert reread.informations == pytest.approx(graph.informations)
    assert list(reread.fixed_nodes) == [5]


def test_an_empty_graph_is_an_empty_file():
    assert parse_g2o(g2o_text(PoseGraph())) == ({}, [], [])
