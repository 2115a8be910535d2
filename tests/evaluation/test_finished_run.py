# SPDX-License-Identifier: Apache-2.0
"""Reading back the graph and the closures of a finished run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cartoloop.errors import InputError
from cartoloop.evaluation.finished_run import Stage, read_run
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.map_file.write import map_bytes
from tests.evaluation.hand_made_run import NODE_POSES, OWN, STAMPS, SUBMAP_POSES, closure
from tests.evaluation.hand_made_run import hand_made_result as hand_made
from tests.global_slam.closures import record
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
    assert final.tf_submap_node[0].tolist() == list(closure(0, 5, 0.1).tf_submap_node)
    assert final.residual_m == pytest.approx([0.1])
    assert final.score.tolist() == [0.7]
    assert found.residual_m == pytest.approx([0.3])
    assert np.isnan(rejected.score).all()


def test_where_nodes_were_inserted_is_not_taken_from_closures(folder):
    run = read_run(folder)

    first = np.flatnonzero((run.own_submap == 1) & (run.own_node == 2))[0]
    assert run.own_pose[first] == pytest.approx((0.0, 0.0, 0.5))


def test_a_missing_file_is_named(folder):
    (folder / "map.cartoloop").unlink()

    with pytest.raises(InputError, match=r"map\.cartoloop: is not there; give a folder"):
        read_run(folder)


def test_a_run_without_nodes_is_refused(tmp_path):
    result = small_result()
    empty = replace(
        result,
        stamps=np.zeros(0),
        trajectory=np.zeros((0, 3)),
        local_trajectory=np.zeros((0, 3)),
        graph=PoseGraph(),
        node_scan_index=np.zeros(0, np.int64),
        submap_grids=[],
        closures=record(),
    )
    (tmp_path / "map.cartoloop").write_bytes(map_bytes(empty))

    with pytest.raises(InputError, match="nothing was mapped"):
        read_run(tmp_path)
