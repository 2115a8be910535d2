# SPDX-License-Identifier: Apache-2.0
"""The tables of nodes and loop closures."""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.config import Config
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust, constraint_residuals
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.map_output.closures_file import (
    CLOSURE_COLUMNS,
    NODE_COLUMNS,
    closures_csv,
    nodes_csv,
)
from cartoloop.pose_adjustment import Loss
from tests.global_slam import closures
from tests.map_output.small_result import small_result


def rows(text):
    return list(csv.DictReader(text.splitlines()))


def closure(x, theta=0.0, node=1, score=0.7, runner_up=0.0):
    """A closure of node 1 of the small result, whose pose in its submap is (1.0, 0.5, 0.1)."""
    information = np.diag((100.0, 100.0, 100.0))
    pose = (1.0 + x, 0.5, 0.1 + theta)
    return closures.closure(
        0, node, pose, information=information, score=score, runner_up=runner_up
    )


def test_a_node_is_named_by_its_scan_and_its_submaps():
    graph = PoseGraph()
    graph.add_submaps(np.zeros((3, 3)))
    graph.add_nodes(np.zeros((2, 3)))
    for submap, node in ((2, 1), (0, 0), (1, 1), (1, 0)):
        kind = ConstraintKind.INTRA_SUBMAP
        graph.add_constraint(kind, submap, node, (0.0, 0.0, 0.0), np.eye(3))
    graph.add_constraint(ConstraintKind.LOOP_CLOSURE, 0, 1, (0.0, 0.0, 0.0), np.eye(3))

    text = nodes_csv(replace(small_result(), graph=graph))

    assert text.splitlines() == [
        ",".join(NODE_COLUMNS), "0,100.000000,0 1", "1,100.400000,1 2",
    ]  # fmt: skip


def test_each_pair_has_a_row_with_its_fate():
    found = [closure(0.1, node=0, runner_up=0.5), closure(0.3)]
    record = closures.record(found, [closure(0.0)], [closure(-0.4, math.radians(-2.0), node=0)])
    record.note_not_searched(record.request(closures.requests((0, 1)), 30), Reason.ENOUGH_CLOSURES)

    table = rows(closures_csv(replace(small_result(), closures=record)).decode())

    assert list(table[0]) == list(CLOSURE_COLUMNS)
    assert [row["status"] for row in table] == ["contradicted", "final", "not_searched"]
    assert [row["reason"] for row in table] == ["disagrees", "fits", "enough_closures"]
    assert [row["search"] for row in table] == ["found", "found", "not_searched"]
    assert [row["runner_up"] for row in table] == ["0.5000", "0.0000", ""]
    assert [row["score"] for row in table] == ["0.7000", "0.7000", ""]
    assert [row["residual"] for row in table] == ["0.2500", "0.2500", ""]
    assert [row["min_score"] for row in table] == ["0.5000", "0.5000", ""]
    assert [row["requested_at"] for row in table] == ["20", "20", "30"]
    assert [row["window_m"] for row in table] == ["1.000"] * 3
    assert [row["window_deg"] for row in table] == ["10.00"] * 3
    assert float(table[1]["residual_m"]) == pytest.approx(0.0, abs=1e-5)
    assert [float(table[1][key]) for key in ("x", "y", "theta")] == [1.0, 0.5, 0.1]
    assert table[2]["x"] == ""


def test_pairs_that_were_never_requested_have_no_window():
    record = closures.record(final=[closure(0.0)])

    [row] = rows(closures_csv(replace(small_result(), closures=record)).decode())

    assert (row["status"], row["search"]) == ("final", "not_requested")
    assert row["window_m"] == row["score"] == row["requested_at"] == ""


def test_the_weight_is_that_of_the_robust_loss():
    record = closures.record([closure(0.2), closure(0.6)])
    settings = {"global_slam": {"pose_adjustment": {"loss": "huber"}}}
    result = small_result(Config.model_validate(settings))
    text = closures_csv(replace(result, closures=record)).decode()
    weights = [float(row["weight"]) for row in rows(text)]

    # E is 2 and 6, and the scale of Huber's loss is 3
    assert weights == pytest.approx([1.0, 0.5])


@pytest.mark.parametrize("loss", list(Loss))
def test_residuals_and_weights_are_those_of_the_adjustment(loss):
    rng = np.random.default_rng(3)
    graph = PoseGraph()
    graph.add_submaps(rng.normal(size=(2, 3)))
    graph.add_nodes(rng.normal(size=(3, 3)))
    graph.fix_submap(0)
    for submap, node in ((0, 0), (0, 1), (1, 1), (1, 2)):
        pose = rng.normal(size=3)
        graph.add_constraint(ConstraintKind.INTRA_SUBMAP, submap, node, pose, 50.0 * np.eye(3))
    record = closures.record(
        final=[
            closures.closure(submap, node, rng.normal(size=3), information=np.diag((9, 4, 1)))
            for submap, node in ((0, 2), (1, 0), (1, 0))
        ]
    )
    closures.add_to_graph(graph, record)
    adjusted = adjust(graph, AdjustmentOptions(loss, 3.0))
    settings = {"global_slam": {"pose_adjustment": {"loss": loss.value, "loss_scale": 3.0}}}
    result = replace(
        small_result(Config.model_validate(settings)),
        graph=graph,
        closures=record,
        stamps=np.arange(3.0),
        node_scan_index=np.arange(3),
    )

    table = rows(closures_csv(result).decode())

    translation, rotation = constraint_residuals(graph)
    residuals = [(float(row["residual_m"]), float(row["residual_deg"])) for row in table]
    expected = np.column_stack((translation, np.degrees(rotation)))[4:]
    np.testing.assert_allclose(residuals, expected, atol=1e-4)
    weights = [float(row["weight"]) for row in table]
    assert weights == pytest.approx(adjusted.weights[4:].tolist(), abs=1e-4)


def test_without_nodes_there_are_only_headers():
    result = replace(
        small_result(),
        stamps=np.zeros(0),
        graph=PoseGraph(),
        node_scan_index=np.zeros(0, np.int64),
        closures=closures.record(),
    )

    assert nodes_csv(result) == ",".join(NODE_COLUMNS) + "\n"
    assert closures_csv(result).decode() == ",".join(CLOSURE_COLUMNS) + "\n"
