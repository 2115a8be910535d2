# SPDX-License-Identifier: Apache-2.0
"""Finished maps whose visits contradict each other are searched again where they do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cartoloop import merge
from cartoloop.config import Config
from cartoloop.config_file import load_config
from cartoloop.earlier_sessions import EarlierMaps
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.map_repair import repair
from cartoloop.quality.examine import examine
from cartoloop.quality.verdict import Kind, Place, Quality, Severity
from cartoloop.quality.visits import contradicted_visits, is_contradicted
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.pose import Pose, compose, compose_all, inverse, relative_all

pytestmark = pytest.mark.slow

KINK = Pose(0.3, 0.4, 0.01)
"""By how much the second half of a map is off: half a metre."""


def with_kink(result, *, num_shared=None):
    """Return a map of a drive in which local SLAM slipped half-way, and no loop is closed.

    The grid of the submap there has no kink: all but its last `num_shared` nodes from before it may
    be taken out of it, since their scans contradict it.
    """
    graph = result.graph
    middle = graph.num_submaps // 2
    old = graph.submap_poses[middle]
    new = np.array(compose(Pose(*old), KINK))
    before = graph.index_b[(graph.kinds == ConstraintKind.INTRA_SUBMAP) & (graph.index_a < middle)]
    last = int(before.max())
    kinked = graph.without(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    if num_shared is not None:
        kinked = kinked.without((kinked.index_a == middle) & (kinked.index_b <= last - num_shared))
    both = (kinked.index_a == middle) & (kinked.index_b <= last)
    kinked.relative_poses[both] = compose_all(np.array(inverse(KINK)), kinked.relative_poses[both])
    kinked.informations[both] *= 0.02  # scans fitted poorly there
    for poses in (kinked.submap_poses[middle:], kinked.node_poses[last + 1 :]):
        poses[:] = compose_all(new, relative_all(old, poses))
    return replace(result, graph=kinked, closures=Closures())


def error(result, true):
    """Return how far the last nodes are off, seen from the first ones [m]."""
    nodes, last = result.graph.node_poses, slice(-20, None)
    right = relative_all(true.graph.node_poses[0], true.graph.node_poses[last])
    return float(np.hypot(*(relative_all(nodes[0], nodes[last]) - right)[:, :2].T).mean())


def slam_of(result, *settings):
    config = load_config(None, settings).config
    return GlobalSlam(config.global_slam, StageTimer(), mapped=EarlierMaps([result]).mapped)


def repaired(result, *settings):
    """Return a map after its repair, None if there was none."""
    config = load_config(None, settings).config
    slam = slam_of(result, *settings)
    try:
        done = repair(slam, lambda: result, config, examine(result, config.quality))
        return replace(result, graph=slam.graph, closures=slam.closures) if done else None
    finally:
        slam.close()


@pytest.fixture(scope="module")
def kinked(two_rounds_result):
    return with_kink(two_rounds_result)


def test_visits_that_contradict_each_other_are_joined(two_rounds_result):
    kinked = with_kink(two_rounds_result, num_shared=1)
    assert is_contradicted(examine(kinked, Config().quality))
    assert error(kinked, two_rounds_result) > 0.4
    found = repaired(kinked)
    assert error(found, two_rounds_result) < 0.06
    assert examine(found, Config().quality).verdict == "good"
    before, after = (contradicted_visits(each, Config().quality).length for each in (kinked, found))
    assert after < 0.2 * before


def test_its_closures_are_in_the_record(kinked):
    found = repaired(kinked)
    rows = np.flatnonzero(found.closures.reason == Reason.REPAIR)
    assert set(found.closures.status[rows].tolist()) <= {Status.FINAL}
    final = np.flatnonzero(found.graph.kinds == ConstraintKind.LOOP_CLOSURE)
    assert len(final) > 0
    assert set(rows.tolist()) <= set(found.graph.closure_rows[final].tolist())


def test_a_repair_is_the_same_each_time(kinked):
    one, other = (repaired(kinked, f"global_slam.num_threads={n}") for n in (1, 3))
    np.testing.assert_array_equal(one.graph.node_poses, other.graph.node_poses)


@pytest.mark.parametrize(
    "setting",
    [
        "global_slam.constraint_search.repair.enabled=false",
        "global_slam.constraint_search.repair.min_length=1e6",
        "global_slam.optimize_every_n_nodes=0",
    ],
)
def test_it_can_be_switched_off(kinked, setting):
    assert repaired(kinked, setting) is None


def test_good_maps_are_left_alone(two_rounds_result):
    class NeverUsed:
        def repair(self, find):
            raise AssertionError(find)

    def never_made():
        raise AssertionError

    config = two_rounds_result.config
    assert not repair(NeverUsed(), never_made, config, two_rounds_result.quality)


def test_merged_maps_are_searched_too(kinked, two_rounds_result):
    notes = []
    merged = merge([kinked, two_rounds_result], note=notes.append)
    assert notes[-1] == "searching where visits contradict each other"
    assert merged.report.stages["repair"].calls == 1


@pytest.mark.parametrize(
    ("kind", "severity", "expected"),
    [
        (Kind.CONTRADICTION, Severity.WRONG, True),
        (Kind.CONTRADICTION, Severity.DOUBTFUL, True),
        (Kind.CONTRADICTION, Severity.MINOR, False),
        (Kind.GAP, Severity.WRONG, False),
    ],
)
def test_contradictions_that_matter_call_for_a_repair(kind, severity, expected):
    place = Place(0.0, 0.0, 1.0, 0.0, 1.0, kind, severity, "", "")
    assert is_contradicted(Quality("doubtful", (place,))) == expected
