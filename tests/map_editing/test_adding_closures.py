# SPDX-License-Identifier: Apache-2.0
"""A closure is added where the scan of a node fits a submap, and refused elsewhere."""

from __future__ import annotations

import re

import numpy as np
import pytest

from cartoloop.errors import InputError, UsageError
from cartoloop.global_slam.closure_status import Status
from cartoloop.map_editing.editor import Editor
from cartoloop.map_file.write import map_bytes
from tests.map_editing.edited_map import poses_of

SUBMAP = 0


@pytest.fixture
def one(ring_result):
    """An editor of the ring, whose only closures are those of its end with its beginning."""
    return Editor(ring_result)


def _closure(one):
    """The closure in the graph whose node is the last."""
    rows = [row for row in one.closures(submap=SUBMAP) if row.is_in_graph]
    return max(rows, key=lambda row: row.node)


def test_a_dropped_closure_is_added_again_where_it_was(one):
    row = _closure(one)
    before = poses_of(one.map)
    one.drop_closures(row.number)
    change = one.add_closure(row.submap, row.node)
    added = one.closures(statuses=["added"])

    assert [(other.number, other.reason) for other in added] == [(row.number, "edit")]
    assert added[0].residual_m < 0.05
    assert change.closures == 1
    assert np.abs(poses_of(one.map) - before).max() < 0.05


def test_a_rough_pose_suffices(one):
    row = _closure(one)
    one.drop_closures(row.number)
    x, y, theta = one.map.graph.node_poses[row.node]
    one.add_closure(row.submap, row.node, (x + 0.6, y - 0.5, theta + 0.15))

    assert one.closures(statuses=["added"])[0].residual_m < 0.05


def test_a_pose_in_the_submap_is_the_same(one):
    row = _closure(one)
    record = one.map.closures
    measured = record.measured
    pose = measured.tf_submap_node[list(measured.row).index(row.number)]
    one.drop_closures(row.number)
    one.add_closure(row.submap, row.node, pose, in_submap=True)

    [added] = one.closures(statuses=["added"])
    assert added.residual_m < 0.05


def test_what_does_not_fit_is_refused_with_its_score(one):
    row = _closure(one)
    one.drop_closures(row.number)
    x, y, theta = one.map.graph.node_poses[row.node]

    with pytest.raises(InputError, match=r"score 0\.\d{3}, 0\.\d{3} is needed") as error:
        one.add_closure(row.submap, row.node, (x + 4.0, y, theta + 1.0), window_m=0.2, window_deg=2)
    score, needed = map(float, re.findall(r"0\.\d{3}", str(error.value))[:2])
    assert score < needed
    assert len(one.edits) == 1


def test_impossible_windows_are_refused(one):
    row = _closure(one)
    one.drop_closures(row.number)
    for window in ({"window_m": 0.0}, {"window_m": 1e6}, {"window_deg": 400.0}):
        with pytest.raises(UsageError, match="is impossible"):
            one.add_closure(row.submap, row.node, **window)


def test_a_pair_without_a_row_gets_one(one):
    graph, record = one.map.graph, one.map.closures
    last = graph.num_nodes - 1
    node = next(n for n in range(last, 0, -1) if record.find(SUBMAP, n) is None)
    one.add_closure(SUBMAP, node)
    [added] = one.closures(statuses=["added"])

    assert added.number == len(record)
    assert (added.submap, added.node) == (SUBMAP, node)
    one.undo()
    assert len(one.map.closures) == len(record)


def test_the_record_of_an_edited_map_can_be_copied(one):
    row = _closure(one)
    one.drop_closures(row.number)
    one.add_closure(row.submap, row.node)
    copied = one.map.closures.copy()

    for name, column in one.map.closures.stored().items():
        np.testing.assert_array_equal(copied.stored()[name], column, err_msg=name)
    assert copied.status[row.number] == Status.ADDED


def test_an_edited_map_keeps_the_map_as_mapped(one, ring_result):
    row = _closure(one)
    one.drop_closures(row.number)
    one.add_closure(row.submap, row.node)
    one.undo(0)
    one.undo(1)

    assert np.array_equal(poses_of(one.map), poses_of(ring_result))
    assert len(map_bytes(one.map)) >= len(map_bytes(ring_result))
