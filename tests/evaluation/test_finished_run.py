# SPDX-License-Identifier: Apache-2.0
"""Reading back the graph and the closures of a finished run."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.errors import InputError
from cartoloop.evaluation.finished_run import read_run
from cartoloop.map_output.closures_file import Stage
from tests.evaluation.hand_made_run import NODE_POSES, OWN, STAMPS, SUBMAP_POSES, closure
from tests.evaluation.hand_made_run import hand_made_result as hand_made
from tests.map_output.small_result import small_result


@pytest.fixture
def folder(tmp_path):
    hand_made([closure(0, 5, 0.1)], [closure(0, 5, 0.3)], [closure(2, 0, 0.5)]).save(tmp_path)
    return tmp_path


def test_a_run_reads_back_as_it_was_saved(folder):
    run = read_run(folder)

    assert np.array_equal(run.stamps, STAMPS)
    assert np.array_equal(run.node_poses, NODE_POSES)
    assert np.array_equal(run.submap_poses, SUBMAP_POSES)
    assert sorted(zip(run.own_submap.tolist(), run.own_node.tolist(), strict=True)) == sorted(OWN)
    assert run.first_submap().tolist() == [0, 0, 1, 1, 2, 2]
    final, found, rejected = (
        run.closures[stage] for stage in (Stage.FINAL, Stage.FOUND, Stage.REJECTED)
    )
    assert (len(final), len(found), len(rejected)) == (1, 1, 1)
    assert (rejected.submap.tolist(), rejected.node.tolist()) == ([2], [0])
    assert final.tf_submap_node[0].tolist() == closure(0, 5, 0.1)["tf_submap_node"].tolist()
    assert final.residual_m == pytest.approx([0.1])
    assert final.score.tolist() == [0.7]
    assert np.isnan(final.runner_up).all()


def test_where_nodes_were_inserted_is_not_taken_from_closures(folder):
    run = read_run(folder)

    first = np.flatnonzero((run.own_submap == 1) & (run.own_node == 2))[0]
    assert run.own_pose[first] == pytest.approx((0.0, 0.0, 0.5))


@pytest.mark.parametrize("name", ["nodes.csv", "closures.csv", "graph.g2o"])
def test_a_missing_file_is_named(folder, name):
    (folder / name).unlink()

    with pytest.raises(InputError, match=rf"has no {name}; give a folder"):
        read_run(folder)


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("nodes.csv", "node,stamp", "a,b", r"nodes\.csv:1: expected the header"),
        ("nodes.csv", "2,102.000000,1", "2,soon,1", r"nodes\.csv:4: is malformed"),
        ("nodes.csv", "2,102.000000,1", "2,nan,1", r"nodes\.csv:4: .*nan is not finite"),
        ("nodes.csv", "2,102.000000,1", "7,102.000000,1", "nodes are not 0, 1, 2"),
        ("nodes.csv", "2,102.000000,1", "2,102.000000,0", "not of the same run"),
        ("closures.csv", "final,0,5", "final,0,5,1", r"closures\.csv:3: .*12 fields where 11"),
        ("closures.csv", "final,0", "finale,0", r"closures\.csv:3: .*'finale'"),
        ("closures.csv", "final,0,5", "final,0,6", "names a node or a submap"),
        ("closures.csv", "rejected,2", "rejected,3", "names a node or a submap"),
    ],
)
def test_malformed_files_are_errors_with_their_line(folder, name, old, new, message):
    path = folder / name
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))

    with pytest.raises(InputError, match=message):
        read_run(folder)


def test_files_of_two_runs_do_not_go_together(folder, tmp_path):
    small_result().save(tmp_path / "other")
    (folder / "graph.g2o").write_bytes((tmp_path / "other" / "graph.g2o").read_bytes())

    with pytest.raises(InputError, match="not of the same run"):
        read_run(folder)


def test_run_without_nodes_is_an_error(folder):
    header = (folder / "nodes.csv").read_text().splitlines()[0]
    (folder / "nodes.csv").write_text(header + "\n")

    with pytest.raises(InputError, match="nothing was mapped"):
        read_run(folder)
