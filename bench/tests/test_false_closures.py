# SPDX-License-Identifier: Apache-2.0
"""Graphs with false closures have the requested share of them, and a figure for each loss."""

import numpy as np
import pytest

from bench.adjustment.false_closures import KINDS, SHARES, graph_with_false_closures, run
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.pose_adjustment import Loss

SMALL = (800, 16, 2_000)


@pytest.mark.parametrize("kind", KINDS)
def test_the_share_of_false_closures_is_as_requested(kind):
    made = graph_with_false_closures(kind, 0.3, 1, SMALL)
    closures = made.graph.kinds == ConstraintKind.LOOP_CLOSURE
    assert not made.is_false[~closures].any()
    assert made.is_false[closures].mean() == pytest.approx(0.3, abs=0.1)
    again = graph_with_false_closures(kind, 0.3, 1, SMALL)
    assert again.graph.relative_poses.tobytes() == made.graph.relative_poses.tobytes()


@pytest.mark.parametrize("kind", KINDS)
def test_half_of_the_closures_may_be_false(kind):
    made = graph_with_false_closures(kind, 0.5, 0, SMALL)
    result = adjust(made.graph, AdjustmentOptions(Loss.GRADUATED_NON_CONVEXITY))
    assert made.error() < 0.02
    np.testing.assert_array_equal(result.weights[made.is_false], 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_the_default_loss_stands_half_false(kind):
    made = graph_with_false_closures(kind, 0.5, 3)
    adjust(made.graph)
    assert made.error() < 0.02


def test_every_loss_has_a_row():
    record = run(1, (Loss.NONE,))
    assert len(record.rows) == 2 * len(KINDS) * len(SHARES)
    assert all(row.figures["mean error"].value >= 0.0 for row in record.rows)
