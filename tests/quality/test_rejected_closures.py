# SPDX-License-Identifier: Apache-2.0
"""A map whose loop closures contradict each other: it says so, whatever was left out of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cartoloop.config import QualityConfig
from cartoloop.global_slam.closure_status import Status
from cartoloop.quality.examine import examine
from cartoloop.quality.rejected_closures import DOUBTFUL_SHARE, MIN_REJECTED, rejected_places
from cartoloop.quality.verdict import Kind, Severity


@pytest.fixture
def with_rejected(two_rounds_result):
    """Return the map with some of its closures rejected."""

    def reject(count):
        closures, graph = two_rounds_result.closures.copy(), two_rounds_result.graph.copy()
        rows = np.flatnonzero(closures.status == Status.FINAL)[:count]
        graph.remove(np.isin(graph.closure_rows, rows))
        closures.note_contradicted(rows)
        return replace(two_rounds_result, closures=closures, graph=graph)

    return reject


def share_of(result, share):
    return round(share * result.graph.num_loop_closures)


def test_many_rejected_closures_make_a_map_doubtful(two_rounds_result, with_rejected):
    count = share_of(two_rounds_result, DOUBTFUL_SHARE + 0.05)
    assert count > MIN_REJECTED
    result = with_rejected(count)
    quality = examine(result, QualityConfig(), result.report.extra["odometry"])
    assert quality.verdict == "doubtful"
    (place,) = (place for place in quality.places if place.kind == Kind.REJECTED)
    assert place.severity == Severity.DOUBTFUL
    total = two_rounds_result.graph.num_loop_closures
    assert place.reason.startswith(f"{count} of {total} loop closures contradict the others")
    nodes = result.closures.node[result.closures.status == Status.CONTRADICTED]
    apart = result.graph.node_poses[nodes, :2] - (place.x, place.y)
    assert np.hypot(apart[:, 0], apart[:, 1]).max() <= place.radius


@pytest.mark.parametrize("share", [0.0, DOUBTFUL_SHARE - 0.05])
def test_few_rejected_closures_leave_it_good(two_rounds_result, with_rejected, share):
    assert rejected_places(with_rejected(share_of(two_rounds_result, share))) == []


def test_a_small_number_says_nothing_of_few_closures(with_rejected):
    result = with_rejected(MIN_REJECTED - 1)
    kept = np.flatnonzero(result.graph.closure_rows >= 0)
    is_removed = np.zeros(result.graph.num_constraints, dtype=bool)
    is_removed[kept[1:]] = True
    result.graph.remove(is_removed)
    assert result.graph.num_loop_closures == 1
    assert rejected_places(result) == []
