# SPDX-License-Identifier: Apache-2.0
"""Precision and recall of loop closures, on a run made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.errors import InputError
from cartoloop.evaluation.closure_scores import (
    Recall,
    evaluate_closures,
    recall,
    true_node_poses,
    true_submap_poses,
)
from cartoloop.evaluation.finished_run import Stage, read_run
from cartoloop.evaluation.trajectories import Trajectory
from cartoloop.report import summarize_constraints
from cartoloop.sensor.pose import compose_all
from tests.evaluation.hand_made_run import (
    NODE_POSES,
    STAMPS,
    SUBMAP_POSES,
    closure,
    hand_made_result,
)

TF_TRUTH_MAP = np.array((3.0, -7.0, 2.5))


@pytest.fixture
def run_of(tmp_path):
    def make(**closures):
        hand_made_result(**closures).save(tmp_path)
        return read_run(tmp_path)

    return make


def truth(poses=NODE_POSES):
    """Truth in which the map is as good as can be, in another frame and out of order."""
    return Trajectory(STAMPS[::-1], compose_all(TF_TRUTH_MAP, poses)[::-1])


def test_closures_within_20_cm_and_1_degree_of_the_map_agree(run_of):
    final = [closure(0, 5), closure(0, 3, 0.19, 0.9), closure(0, 4, 0.21), closure(2, 0, 0, -1.1)]
    found = [closure(0, 5, 0.3), closure(0, 4)]

    score = evaluate_closures(run_of(final=final, found=found, rejected=[closure(1, 0, 1.0)]))

    assert (score.final.constraints, score.final.agreeing, score.final.rejected) == (4, 2, 1)
    assert score.final.precision == pytest.approx(2 / 5)
    assert (score.found.constraints, score.found.agreeing) == (2, 1)
    assert score.final.true is None
    assert score.final.true_precision is None
    assert score.final.recall is None


def test_precision_is_that_of_the_report(tmp_path):
    rng = np.random.default_rng(5)
    made = [
        closure(int(s), int(n), float(dx), float(turn))
        for (s, n), dx, turn in zip(
            rng.permutation([(s, n) for s in range(3) for n in range(6)]),
            rng.uniform(0, 0.3, 18), rng.uniform(-1.5, 1.5, 18), strict=True,
        )
    ]  # fmt: skip
    result = hand_made_result(made[:12], made[4:], made[12:14])
    result.save(tmp_path)
    summary = summarize_constraints(result.graph, result.closures)

    score = evaluate_closures(read_run(tmp_path))

    assert 0 < summary.precision < 1
    assert score.final.precision == summary.precision
    assert score.found.precision == summary.found_precision
    assert score.final.constraints == summary.loop_closure
    assert score.final.rejected == summary.rejected


def test_without_closures_there_is_no_precision(run_of):
    score = evaluate_closures(run_of(), truth())

    assert score.final.precision is None
    assert score.final.true_precision is None
    assert score.final.true == 0


def test_a_closure_that_the_map_agrees_with_can_be_false(run_of):
    poses = NODE_POSES.copy()
    poses[5] += (0.5, 0.0, 0.0)  # the map has the last node 50 cm off
    final = [closure(0, 5), closure(0, 5, 0.5), closure(1, 0), closure(0, 2, 0.1)]

    score = evaluate_closures(run_of(final=final, rejected=[closure(0, 5, 0.45)]), truth(poses))

    assert (score.final.agreeing, score.final.true) == (3, 3)
    assert score.final.true_precision == pytest.approx(3 / 4)
    assert score.final.true_rejected == 1


def test_one_wrongly_inserted_scan_moves_no_submap(run_of):
    poses = NODE_POSES.copy()
    poses[3] += (5.0, 2.0, 1.0)
    run = run_of()

    true_submaps = true_submap_poses(run, true_node_poses(run, truth(poses)))

    # nodes 1 and 2 of submap 1 and nodes 4 and 5 of submap 2 outvote node 3
    assert true_submaps[1:] == pytest.approx(compose_all(TF_TRUTH_MAP, SUBMAP_POSES)[1:], abs=1e-9)


@pytest.mark.parametrize("turn", [0.0, math.pi - 1.0, math.pi, -math.pi + 1e-4])
def test_submaps_are_found_at_any_heading(run_of, turn):
    run = run_of()
    tf_truth_map = np.array((1.0, 2.0, turn))
    rng = np.random.default_rng(1)
    noise = rng.normal(scale=1e-3, size=NODE_POSES.shape)

    true_submaps = true_submap_poses(run, compose_all(tf_truth_map, NODE_POSES + noise))

    expected = compose_all(tf_truth_map, SUBMAP_POSES)
    difference = np.remainder(true_submaps - expected + 1.0, [1e9, 1e9, 2 * math.pi]) - 1.0
    assert np.abs(difference).max() < 0.02


def test_recall_counts_pairs_and_revisits_with_a_true_closure(run_of):
    run = run_of(final=[closure(0, 3), closure(0, 4), closure(2, 0)])
    pairs = np.array([(0, 2), (0, 3), (0, 4), (0, 5), (1, 0), (1, 5)])

    found = recall(run, run.closures[Stage.FINAL], np.array([True, False, True]), pairs)

    # revisits: submap 0 by 1 and by 2, submap 1 by 0 and by 2
    assert found == Recall(pairs=6, pairs_closed=1, revisits=4, revisits_closed=1)
    assert found.of_pairs == pytest.approx(1 / 6)
    assert found.of_revisits == pytest.approx(1 / 4)


def test_nothing_to_close_has_no_recall():
    assert Recall(0, 0, 0, 0).of_pairs is None
    assert Recall(0, 0, 0, 0).of_revisits is None


def test_truth_without_a_node_is_an_error(run_of):
    partial = Trajectory(STAMPS[:4] + 1e-3, NODE_POSES[:4])

    with pytest.raises(InputError, match=r"no pose for 2 of 6 nodes, first at stamp 104\.000000"):
        evaluate_closures(run_of(), partial)


def test_recall_without_truth_cannot_be(run_of):
    with pytest.raises(ValueError, match="needs the truth"):
        evaluate_closures(run_of(), log=object())


def test_the_dictionary_holds_the_shares(run_of):
    score = evaluate_closures(run_of(final=[closure(0, 5)], found=[closure(0, 4, 0.3)]), truth())

    values = score.to_dict()

    assert values["final"]["precision"] == 1.0
    assert values["found"]["precision"] == 0.0
    assert values["final"]["true_precision"] == 1.0
    assert values["found"]["recall"] is None
