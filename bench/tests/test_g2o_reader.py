# SPDX-License-Identifier: Apache-2.0
"""2D pose graphs in g2o's format: read right, placed where no line does, or refused."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from bench.g2o import read_g2o
from cartoloop.errors import InputError
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.sensor.pose import Pose, compose, relative

DATA = Path(os.environ.get("CARTOLOOP_DATA", Path(__file__).parents[2] / "../shared/data"))

SQUARE = """\
# a comment, and a line of another kind
TUTORIAL_NOTHING 1 2 3
VERTEX_SE2 7 1.0 0.0 0.5
VERTEX_SE2 3 0.0 0.0 0.0

EDGE_SE2 3 7 1.0 0.0 0.5 4.0 1.0 0.5 9.0 -0.5 25.0
FIX 7
"""


def written(tmp_path, text, name="graph.g2o"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_vertices_become_nodes_in_the_order_of_their_ids(tmp_path):
    graph = read_g2o(written(tmp_path, SQUARE))
    np.testing.assert_array_equal(graph.node_poses, [(0.0, 0.0, 0.0), (1.0, 0.0, 0.5)])
    assert graph.num_submaps == 0
    assert list(graph.kinds) == [ConstraintKind.NODE_TO_NODE]
    assert (graph.index_a[0], graph.index_b[0]) == (0, 1)
    np.testing.assert_array_equal(graph.relative_poses, [(1.0, 0.0, 0.5)])
    assert graph.fixed_nodes == (1,)


def test_the_squared_error_is_that_of_g2o(tmp_path):
    graph = read_g2o(written(tmp_path, SQUARE))
    measured, information = (
        Pose(1.0, 0.0, 0.5),
        np.array([[4, 1, 0.5], [1, 9, -0.5], [0.5, -0.5, 25]]),
    )
    rng = np.random.default_rng(0)
    for a, b in rng.normal(0.0, 0.4, (20, 2, 3)):
        seen = relative(Pose(*a), Pose(*b))
        g2o_error = np.array(relative(measured, seen))
        ours = np.array(measured) - np.array(seen)
        assert ours @ graph.informations[0] @ ours == pytest.approx(
            g2o_error @ information @ g2o_error
        )


def test_a_compressed_file_reads_the_same(tmp_path):
    plain = read_g2o(written(tmp_path, SQUARE))
    path = tmp_path / "graph.g2o.gz"
    path.write_bytes(gzip.compress(SQUARE.encode()))
    np.testing.assert_array_equal(read_g2o(path).informations, plain.informations)


def test_vertices_without_a_line_are_chained_along_the_edges(tmp_path):
    edges = "EDGE_SE2 1 2 1 0 1.0 1 0 0 1 0 1\nEDGE_SE2 3 2 2 0 0.5 1 0 0 1 0 1\n"
    graph = read_g2o(written(tmp_path, edges + "EDGE_SE2 8 9 0 1 0 1 0 0 1 0 1\n"))
    second = Pose(1.0, 0.0, 1.0)
    np.testing.assert_allclose(graph.node_poses[0], (0.0, 0.0, 0.0))
    np.testing.assert_allclose(graph.node_poses[1], second)
    third_to_second = compose(Pose(*graph.node_poses[2]), Pose(2.0, 0.0, 0.5))
    np.testing.assert_allclose(third_to_second, second, atol=1e-12)
    np.testing.assert_allclose(graph.node_poses[3:], [(0.0, 0.0, 0.0), (0.0, 1.0, 0.0)])


def test_vertices_without_a_line_are_chained_to_those_with_one(tmp_path):
    text = "VERTEX_SE2 2 5 5 0\nEDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\n"
    graph = read_g2o(written(tmp_path, text))
    np.testing.assert_allclose(graph.node_poses, [(4.0, 5.0, 0.0), (5.0, 5.0, 0.0)])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("VERTEX_SE2 1 0.0 0.0", "3 numbers where 4 are due"),
        ("VERTEX_SE2 one 0.0 0.0 0.0", "malformed"),
        ("VERTEX_SE2 1 0.0 nan 0.0", "not finite"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0", "10 numbers where 11 are due"),
        ("EDGE_SE2 0 1 1 0 zero 1 0 0 1 0 1", "malformed"),
        ("EDGE_SE2 0 0 1 0 0 1 0 0 1 0 1", "joined to itself"),
        ("EDGE_SE2 0 1 1 0 0 1 5 0 1 0 1", "not positive semidefinite"),
        ("FIX zero", "malformed"),
        (f"VERTEX_SE2 {'9' * 5000} 0 0 0", "malformed"),
        (f"EDGE_SE2 0 {'9' * 400} 1 0 0 1 0 0 1 0 1", "malformed"),
        ("EDGE_SE2 0 1 1 0 0 1e308 1e308 1e308 1e308 1e308 1e308", "malformed"),
    ],
)
def test_a_malformed_line_is_skipped_and_named(tmp_path, caplog, line, message):
    path = written(tmp_path, f"VERTEX_SE2 0 0 0 0\n{line}\nVERTEX_SE2 2 1 0 0\n")

    assert read_g2o(path).num_nodes == 2
    (warning,) = caplog.messages
    assert warning.startswith(f"1 lines are skipped, the first: {path}:2: ")
    assert message in warning


@pytest.mark.parametrize("text", ["", "hello\n", "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n"])
def test_a_file_without_a_2d_graph_is_refused(tmp_path, text):
    with pytest.raises(InputError, match="neither VERTEX_SE2 nor EDGE_SE2"):
        read_g2o(written(tmp_path, text))


def test_fixing_a_vertex_that_is_not_there_is_skipped(tmp_path, caplog):
    graph = read_g2o(written(tmp_path, "VERTEX_SE2 0 0 0 0\nFIX 4\n"))

    assert graph.num_nodes == 1
    assert "FIX names vertex 4" in caplog.text


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(InputError, match="absent"):
        read_g2o(tmp_path / "absent.g2o")
    binary = tmp_path / "binary.g2o"
    binary.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputError, match="not text"):
        read_g2o(binary)
    cut = tmp_path / "cut.g2o.gz"
    cut.write_bytes(gzip.compress(SQUARE.encode())[:-20])
    with pytest.raises(InputError, match="cannot be read"):
        read_g2o(cut)


# name: vertices, edges
GRAPHS = {
    "intel": (1728, 2512),
    "mit": (808, 827),
    "csail": (1045, 1172),
    "m3500": (3500, 5453),
    "m3500b": (3500, 5453),
    "manhattanOlson3500": (3500, 5598),
    "ringCity": (2361, 3261),
}


@pytest.mark.data
@pytest.mark.parametrize("name", GRAPHS)
def test_a_public_graph_is_read_whole(name):
    path = DATA / f"pose-graphs/{name}.g2o.gz"
    if not path.exists():
        pytest.skip(f"{path} is absent: set CARTOLOOP_DATA to the folder of the recordings")
    graph = read_g2o(path)
    assert (graph.num_nodes, graph.num_constraints) == GRAPHS[name]
