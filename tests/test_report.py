# SPDX-License-Identifier: Apache-2.0
"""What the report counts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.report import Report, sensor_warnings, summarize_constraints
from tests.global_slam.closures import add_to_graph, closure, record


def seen(x, degrees):
    return closure(0, 0, (2.0 + x, 0.0, math.radians(degrees)))


def summary_of(*final, **others):
    """One submap, a node seen from it, and closures that are off by the given (x, degrees)."""
    graph = PoseGraph()
    graph.add_submap((0.0, 0.0, 0.0))
    graph.add_node((2.0, 0.0, 0.0))
    graph.add_constraint(ConstraintKind.INTRA_SUBMAP, 0, 0, (9.0, 9.0, 1.0), np.eye(3))
    parts = {name: [seen(*error) for error in errors] for name, errors in others.items()}
    closures = record(final=[seen(*error) for error in final], **parts)
    add_to_graph(graph, closures)
    return summarize_constraints(graph, closures)


def test_closures_within_20_cm_and_1_degree_are_true():
    summary = summary_of((0.0, 0.0), (0.19, 0.9), (-0.21, 0.0), (0.0, -1.1), (0.1, -0.5))

    assert summary.intra_submap == 1
    assert summary.loop_closure == 5
    assert summary.precision == pytest.approx(3 / 5)


def test_contradicted_closures_count_as_wrong():
    summary = summary_of((0.0, 0.0), rejected=[(0.1, 0.0)])

    assert summary.rejected == 1
    assert summary.precision == pytest.approx(1 / 2)


def test_found_closures_are_judged_by_the_final_poses():
    summary = summary_of(found=[(0.1, 0.0), (0.0, 1.5), (0.3, 0.0), (0.0, -0.5)])

    assert summary.searched == summary.found == 4
    assert summary.found_precision == pytest.approx(0.5)


def test_fates_add_up_to_the_pairs_searched_and_found():
    summary = summary_of((0.0, 0.0), found=[(0.1, 0.0), (0.0, 1.5)])

    assert summary.fates_of_searched == summary.fates_of_found == {"replaced": 1, "final": 1}
    assert summary.fates == summary.fates_of_found


def test_without_closures_there_is_no_precision():
    for summary in (summarize_constraints(PoseGraph(), record()), summary_of()):
        assert summary.precision is None
        assert summary.found_precision is None


def test_stable_keys_of_a_report_cannot_be_replaced():
    with pytest.raises(ValueError, match="nodes"):
        Report(extra={"nodes": 3, "findings": []}).to_json()


def test_warnings_of_sensors_are_collected():
    odometry = {"turn_ratio": -1.0, "jumps": 50, "readings": 100}
    ranges = {"front": 6.31}
    side, jumps, noise = sensor_warnings(
        Report(extra={"odometry": odometry, "useful_range_m": ranges})
    )
    assert "other side" in side
    assert "50 of its 99 steps" in jumps
    assert noise.startswith("returns of front")


def test_a_scanner_that_is_noisy_far_away_is_reported():
    assert sensor_warnings(Report()) == []
    [warning] = sensor_warnings(Report(extra={"useful_range_m": {"front": 6.31}}))
    assert warning.startswith("returns of front beyond 6.3 m were left out: ")
