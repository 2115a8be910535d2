# SPDX-License-Identifier: Apache-2.0
"""The tables of nodes and loop closures."""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.config import Config
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust, constraint_residuals
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.map_output.closures_file import (
    CLOSURE_COLUMNS,
    NODE_COLUMNS,
    closures_csv,
    nodes_csv,
)
from cartoloop.pose_adjustment import Loss
from cartoloop.sensor.pose import Pose
from tests.global_slam import closures
from tests.map_output.small_result import small_result


def rows(text):
    return list(csv.DictReader(text.splitlines()))


def closure(x, theta=0.0, node=1, score=0.7, runner_up=math.nan):
    """A closure of node 1 of the small result, which stands at (1.0, 0.5, 0.1) in its submap."""
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


def test_each_stage_has_its_rows_with_what_was_measured():
    result = replace(
        small_result(),
        found=closures.closures(closure(0.1, runner_up=0.5), closure(0.3)),
        rejected=closures.closures(closure(-0.4, theta=math.radians(-2.0), score=0.6)),
    )

    table = rows(closures_csv(result))

    assert list(table[0]) == list(CLOSURE_COLUMNS)
    assert [row["stage"] for row in table] == ["found", "found", "final", "rejected"]
    assert [row["runner_up"] for row in table] == ["0.5", "", "", ""]
    assert [row["score"] for row in table] == ["0.7", "0.7", "", "0.6"]
    residuals = [float(row["residual_m"]) for row in table]
    assert residuals == pytest.approx([0.1, 0.3, 0.0, 0.4])
    assert float(table[3]["residual_deg"]) == pytest.approx(2.0)
    seen = [float(table[1][key]) for key in ("x", "y", "theta")]
    assert seen == result.found["tf_submap_node"][1].tolist()


def test_the_weight_is_what_the_loss_leaves():
    result = replace(small_result(), found=closures.closures(closure(0.2), closure(0.6)))
    weights = [float(row["weight"]) for row in rows(closures_csv(result))]

    # E is 2 and 6, and Huber's loss bends at 3
    assert weights == pytest.approx([1.0, 0.5, 1.0])


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
    for submap, node in ((0, 2), (1, 0), (1, 0)):
        pose = rng.normal(size=3)
        graph.add_constraint(ConstraintKind.LOOP_CLOSURE, submap, node, pose, np.diag((9, 4, 1)))
    adjusted = adjust(graph, AdjustmentOptions(loss, 3.0))
    settings = {"global_slam": {"pose_adjustment": {"loss": loss.value, "loss_scale": 3.0}}}
    result = replace(
        small_result(Config.model_validate(settings)),
        graph=graph,
        stamps=np.arange(3.0),
        node_scan_index=np.arange(3),
    )

    table = rows(closures_csv(result))

    translation, rotation = constraint_residuals(graph)
    residuals = [(float(row["residual_m"]), float(row["residual_deg"])) for row in table]
    expected = np.column_stack((translation, np.degrees(rotation)))[4:]
    np.testing.assert_allclose(residuals, expected, rtol=1e-12)
    weights = [float(row["weight"]) for row in table]
    assert weights == pytest.approx(adjusted.weights[4:].tolist(), rel=1e-6)


def test_numbers_read_back_as_they_were():
    seen = Pose(1 / 3, -2e-17, 0.1 + 0.2)
    found = closures.closures(closures.closure(0, 1, seen, score=2 / 3))
    result = replace(small_result(), found=found)

    row = rows(closures_csv(result))[0]

    assert Pose(*(float(row[key]) for key in ("x", "y", "theta"))) == seen
    assert float(row["score"]) == 2 / 3


def test_without_nodes_there_are_only_headers():
    result = replace(
        small_result(),
        stamps=np.zeros(0),
        graph=PoseGraph(),
        node_scan_index=np.zeros(0, np.int64),
    )

    assert nodes_csv(result) == ",".join(NODE_COLUMNS) + "\n"
    assert closures_csv(result) == ",".join(CLOSURE_COLUMNS) + "\n"
