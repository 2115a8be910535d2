# SPDX-License-Identifier: Apache-2.0
"""Relations from a run that closed its loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cartoloop.errors import InputError
from cartoloop.evaluation.finished_run import read_run
from cartoloop.evaluation.make_relations import make_relations, relations_text
from cartoloop.evaluation.relations import evaluate_relations, read_relations
from cartoloop.evaluation.trajectories import Trajectory
from cartoloop.sensor.pose import relative_all
from cartoloop.session import Session
from tests.evaluation.hand_made_run import NODE_POSES, STAMPS, closure, hand_made_result


@pytest.fixture
def run_of(tmp_path):
    def make(*final):
        hand_made_result(final=final).save(tmp_path)
        return read_run(tmp_path)

    return make


def pairs(relations):
    return [tuple(pair) for pair in (relations.stamps - STAMPS[0]).astype(int).tolist()]


def test_relation_joins_middle_of_submap_and_matched_scan(run_of):
    # the middle nodes of the submaps are 1, 2 and 4
    relations = make_relations(run_of(closure(0, 5), closure(0, 4), closure(2, 0)), min_distance=1)

    assert pairs(relations) == [(0, 4), (1, 4), (1, 5)]
    first, second = NODE_POSES[[0, 1, 1]], NODE_POSES[[4, 4, 5]]
    assert relations.poses == pytest.approx(relative_all(first, second))


def test_relations_are_of_one_session(tmp_path):
    result = hand_made_result(final=(closure(0, 5), closure(2, 0), closure(1, 0)))
    sessions = (Session(), Session(first_scan=3, first_node=3, first_submap=2))
    replace(result, sessions=sessions).save(tmp_path)

    assert pairs(make_relations(read_run(tmp_path), min_distance=1)) == [(0, 2)]


def test_closures_after_a_short_way_say_nothing(run_of):
    # node 1 is a path of 12 m from node 4, and 17.5 m from node 5
    run = run_of(closure(0, 5), closure(0, 4))

    assert pairs(make_relations(run, min_distance=12.0)) == [(1, 4), (1, 5)]
    assert pairs(make_relations(run, min_distance=12.1)) == [(1, 5)]


def test_closures_that_the_map_disagrees_with_are_left_out(run_of):
    run = run_of(closure(0, 5, 0.16), closure(0, 4, 0.0, 1.2), closure(0, 3, 0.14, -1.1))

    assert pairs(make_relations(run, min_distance=1.0)) == [(1, 3)]
    assert pairs(make_relations(run, 1.0, max_translation=0.2)) == [(1, 3), (1, 5)]
    assert pairs(make_relations(run, 1.0, max_rotation=0.03)) == [(1, 3), (1, 4)]


def test_relations_are_unique_and_join_two_scans(run_of):
    # submap 0's middle is node 1, submap 2's is node 4
    run = run_of(closure(0, 4), closure(2, 1), closure(0, 4, 0.1), closure(0, 1), closure(2, 4))

    assert pairs(make_relations(run, min_distance=0.0)) == [(1, 4)]


def test_scans_whose_stamp_is_not_theirs_alone_are_left_out(tmp_path):
    result = hand_made_result(final=[closure(0, 5), closure(0, 4)])
    stamps = np.append(STAMPS, STAMPS[5])  # the last scan became no node
    trajectory = np.vstack((NODE_POSES, (9.0, 9.0, 0.0)))
    replace(result, stamps=stamps, trajectory=trajectory, local_trajectory=trajectory).save(
        tmp_path
    )

    assert pairs(make_relations(read_run(tmp_path), min_distance=1.0)) == [(1, 4)]


def test_a_trajectory_of_another_run_is_refused(run_of, tmp_path):
    run = run_of(closure(0, 5))
    path = run.folder / "trajectory.tum"
    path.write_text("1 0 0 0 0 0 0 1\n")

    with pytest.raises(InputError, match=r"trajectory\.tum: is not of the same run"):
        make_relations(run, 1.0)


def test_the_run_itself_agrees_and_a_drifted_one_does_not(run_of, tmp_path):
    made = make_relations(run_of(closure(0, 5), closure(0, 4)), min_distance=1.0)
    path = tmp_path / "made.relations"
    path.write_text(relations_text(made))

    read = read_relations(path)
    itself = evaluate_relations(Trajectory(STAMPS, NODE_POSES), read)
    drift = NODE_POSES + np.outer(np.arange(6), (0.1, 0.0, 0.0))
    drifted = evaluate_relations(Trajectory(STAMPS, drift), read)

    assert np.array_equal(read.stamps, made.stamps)
    assert itself.absolute_translational.mean < 1e-8
    assert drifted.absolute_translational.mean == pytest.approx(0.35)


def test_the_text_is_eight_numbers_a_line_without_a_header(run_of):
    lines = relations_text(make_relations(run_of(closure(0, 5)), 1.0)).splitlines()

    assert lines[0].startswith("101.000000 105.000000 -3.")
    assert [len(line.split()) for line in lines] == [8]


def test_run_without_such_closures_is_an_error(run_of):
    with pytest.raises(
        InputError, match=r"of 1 loop closures none .* a path of 100 m .* 21 m long"
    ):
        make_relations(run_of(closure(0, 5)))
