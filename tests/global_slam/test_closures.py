# SPDX-License-Identifier: Apache-2.0
"""The record of closures: every pair keeps its row, and the fates add up."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.global_slam.closure_matches import FinalMatches
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.closures import Closures
from tests.global_slam.closures import INFORMATION, closure, record, requests, search_matches
from tests.global_slam.closures import final_matches as matches_of

POSE = (1.0, 2.0, 0.5)


def final_matches(*pairs, reasons=None, x=9.0):
    count = len(pairs)
    submaps, nodes = np.array(pairs).reshape(-1, 2).T
    return FinalMatches(
        submap=submaps,
        node=nodes,
        tf_submap_node=np.tile((x, 0.0, 0.0), (count, 1)),
        information=np.tile(INFORMATION, (count, 1, 1)),
        residual=np.full(count, 0.25),
        moved_m=np.full(count, 0.125),
        moved_rad=np.full(count, 0.5),
        reason=np.array(reasons or [Reason.FITS] * count, dtype=np.int8),
    )


def searched():
    """Five requests: two found, two not found, one not searched."""
    closures = Closures()
    rows = closures.request(requests((0, 7), (0, 8), (1, 7), (1, 9), (1, 11)), 12)
    closures.note_searched(rows[:4], 0.5)
    closures.note_not_searched(rows[4:], Reason.ENOUGH_CLOSURES)
    closures.add_found(search_matches(rows[[3, 0]], POSE, score=0.75, runner_up=0.5), 20)
    return closures


def statuses(closures):
    return [Status(status).name for status in closures.status.tolist()]


def reasons(closures):
    return [Reason(reason).name for reason in closures.reason.tolist()]


def assert_counts_add_up(closures):
    asked = closures.status[: closures.num_requested]
    was_searched = closures.was_searched[: closures.num_requested]
    assert closures.num_searched == sum(
        np.count_nonzero(was_searched & (asked == status)) for status in Status
    )
    fates = (
        Status.FOUND, Status.REPLACED, Status.FINAL, Status.POOR_FIT, Status.MOVED_TOO_FAR,
        Status.CONTRADICTED,
    )  # fmt: skip
    of_found = closures.status[closures.found.row]
    assert closures.num_found == sum(np.count_nonzero(of_found == fate) for fate in fates)
    assert sum(closures.counts().values()) == len(closures)


def test_a_request_waits_until_it_is_searched():
    closures = Closures()
    rows = closures.request(requests((3, 4), (3, 6)), 10)

    assert rows.tolist() == [0, 1]
    assert statuses(closures) == ["WAITING", "WAITING"]
    assert closures.requested_at.tolist() == [10, 10]
    assert closures.num_searched == 0
    assert np.isnan(closures.score).all()
    assert closures.find(3, 6) == 1
    assert closures.find(6, 3) is None


def test_search_results_are_kept():
    closures = searched()

    assert statuses(closures) == ["FOUND", "NOT_FOUND", "NOT_FOUND", "FOUND", "NOT_SEARCHED"]
    assert reasons(closures)[1] == "BELOW_THRESHOLD"
    assert closures.min_score[:4].tolist() == [0.5] * 4
    assert np.isnan(closures.min_score[4])
    assert closures.num_searched == 4
    assert closures.num_found == 2
    assert closures.found.row.tolist() == [3, 0]
    assert closures.found_at[[0, 3]].tolist() == [20, 20]
    assert closures.score[[0, 3]].tolist() == [0.75, 0.75]
    assert closures.runner_up[0] == 0.5
    assert_counts_add_up(closures)


def test_found_closures_keep_pose_and_information():
    found = searched().found

    assert found.tf_submap_node.tolist() == [list(POSE)] * 2
    np.testing.assert_array_equal(found.information, [INFORMATION] * 2)
    assert list(zip(found.submap.tolist(), found.node.tolist(), strict=True)) == [(1, 9), (0, 7)]


def test_dropped_requests_have_a_reason():
    closures = Closures()
    closures.note_dropped(closures.request(requests((0, 1)), 5))

    assert statuses(closures) == ["DROPPED"]
    assert reasons(closures) == ["BACKLOG_FULL"]


def last_pass(closures, x=9.0):
    """Match one found pair, one not found, one never requested, and one that does not fit."""
    return closures.note_last_pass(
        np.array((Reason.NO_OVERLAP, Reason.EVERY_NTH_NODE), dtype=np.int8),
        [
            final_matches((0, 7), (0, 8), (0, 2), x=x),
            final_matches((1, 3), reasons=[Reason.RESIDUAL]),
        ],
    )


def test_the_last_pass_measures_pairs_again():
    closures = searched()
    rows = last_pass(closures)

    assert [each.tolist() for each in rows] == [[0, 1, 5], [6]]
    assert statuses(closures) == [
        "FINAL", "FINAL", "NOT_FOUND", "REPLACED", "NOT_SEARCHED", "FINAL", "POOR_FIT",
    ]  # fmt: skip
    assert reasons(closures)[3] == "NO_OVERLAP"
    final = closures.with_status(Status.FINAL)
    assert final.row.tolist() == [0, 1, 5]
    assert (final.tf_submap_node[:, 0] == 9.0).all()
    assert final.residual.tolist() == [0.25] * 3
    assert final.score[0] == 0.75
    assert np.isnan(final.score[1:]).all()
    assert closures.moved[6].tolist() == [0.125, 0.5]
    assert_counts_add_up(closures)


def test_what_the_search_found_outlives_the_last_pass():
    closures = searched()
    last_pass(closures)

    assert closures.found.tf_submap_node.tolist() == [list(POSE)] * 2
    assert closures.search_status[0] == Status.FOUND
    assert closures.search_status[5] == Status.NOT_REQUESTED
    assert closures.num_requested == 5


def test_a_second_pass_replaces_the_first():
    once, twice = searched(), searched()
    last_pass(once, x=4.0)
    last_pass(twice)
    twice.note_last_pass(np.full(2, Reason.NO_OVERLAP, np.int8), [])
    assert statuses(twice) == ["REPLACED", "NOT_FOUND", "NOT_FOUND", "REPLACED", "NOT_SEARCHED"]
    assert reasons(twice)[1] == "BELOW_THRESHOLD"
    last_pass(twice, x=4.0)

    assert_equal(once, twice)


def test_contradicted_closures_keep_their_measurement():
    closures = searched()
    rows = last_pass(closures)
    closures.note_contradicted(rows[0][:1])

    assert statuses(closures)[0] == "CONTRADICTED"
    assert reasons(closures)[0] == "DISAGREES"
    assert closures.with_status(Status.CONTRADICTED).tf_submap_node[0, 0] == 9.0
    assert_counts_add_up(closures)


def test_a_copy_does_not_change_with_the_record():
    closures = searched()
    copied, same = closures.copy(), closures.copy()
    last_pass(closures)

    assert_equal(copied, same)
    assert len(copied) == 5


def assert_equal(one, other):
    for name, column in one.stored().items():
        np.testing.assert_array_equal(column, other.stored()[name], err_msg=name)


def test_an_empty_record_has_no_rows():
    closures = Closures()
    assert closures.note_last_pass(np.zeros(0, np.int8), [final_matches((0, 1))]) is not None
    closures.note_last_pass(np.zeros(0, np.int8), [])

    assert len(closures) == len(closures.found) == len(closures.measured) == 0


@pytest.mark.parametrize("kind", [Status, Reason])
def test_codes_fit_their_columns(kind):
    assert [member.value for member in kind] == list(range(len(kind)))
    assert len(kind) < 128


def test_a_closure_that_an_edit_removed_can_be_added_again():
    closures = record(found=[closure(0, 1)], final=[closure(0, 1), closure(0, 2)])
    closures.note_removed(np.array([0, 1]))
    assert set(closures.status.tolist()) == {Status.REMOVED}

    for node, row in ((1, 0), (2, 1), (5, 2)):  # the last was never matched
        added = matches_of([closure(0, node, (1.0, 2.0, 0.5), residual=0.125)], [Reason.EDIT])
        assert closures.note_added(added) == row
    measured = closures.with_status(Status.ADDED)

    assert measured.node.tolist() == [1, 2, 5]
    assert measured.tf_submap_node.tolist() == [[1.0, 2.0, 0.5]] * 3
    assert measured.residual.tolist() == [0.125] * 3
    assert closures.found.tf_submap_node.tolist() == [[0.0, 0.0, 0.0]]  # as the search measured it
    assert closures.copy().with_status(Status.ADDED).row.tolist() == [0, 1, 2]


def test_pairs_that_are_searched_again_keep_their_rows():
    closures = record(found=[closure(0, 5), closure(1, 6)])
    wanted = requests((1, 6))._replace(linear_window=np.array((2.5,)))
    closures.request_again(np.array((1,)), wanted)
    assert closures.linear_window.tolist() == [1.0, 2.5]
    assert closures.num_requested == 2
    assert closures.counts()[Status.FOUND] == 2
