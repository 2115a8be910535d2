# SPDX-License-Identifier: Apache-2.0
"""Global SLAM as a whole: nodes in, loop closures, adjustments and the last pass out."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import ConstraintSearchConfig, GlobalSlamConfig
from cartoloop.global_slam import refinement
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.pose import Pose, relative
from cartoloop.submaps.finished_grid import MAX_PROBABILITY, MIN_PROBABILITY
from cartoloop.submaps.node import Node
from cartoloop.submaps.probability_grid import ProbabilityGrid
from cartoloop.submaps.submap import Submap

NUM_NODES, NODES_A_SUBMAP = 48, 6
HALF_ROOM = np.array((3.0, 2.0))
RESOLUTION = 0.05
DRIFT_M = 0.01
"""Error of the local pose that is added with every node [m]."""

FATES_OF_FOUND = (
    Status.FOUND, Status.REPLACED, Status.FINAL, Status.POOR_FIT, Status.MOVED_TOO_FAR,
    Status.CONTRADICTED,
)  # fmt: skip


def true_pose(node):
    """To and fro along the room."""
    return Pose(0.6 * np.sin(node / 5.0), 0.2 * np.cos(node / 7.0), 0.0)


def local_pose(node):
    pose = true_pose(node)
    return Pose(pose.x + DRIFT_M * node, pose.y, pose.theta)


def walls():
    """Points on the walls of the room, map frame."""
    x = np.arange(-HALF_ROOM[0], HALF_ROOM[0] + 0.01, RESOLUTION)
    y = np.arange(-HALF_ROOM[1], HALF_ROOM[1] + 0.01, RESOLUTION)
    sides = [np.column_stack((x, np.full(len(x), side))) for side in (-2.0, 2.0)]
    ends = [np.column_stack((np.full(len(y), end), y)) for end in (-3.0, 3.0)]
    return np.concatenate(sides + ends)


def submap(index, first_node):
    """A submap with the whole room in it, as seen from its first node."""
    pose, local = true_pose(first_node), local_pose(first_node)
    grid = ProbabilityGrid(RESOLUTION)
    grid.cover(-90, -90, 90, 90)
    grid.cells[:] = MIN_PROBABILITY
    cells = np.rint((walls() - pose[:2]) / RESOLUTION).astype(int)
    grid.cells[cells[:, 1] - grid.first_row, cells[:, 0] - grid.first_col] = MAX_PROBABILITY
    return Submap(index, Pose(local.x, local.y, 0.0), grid)


def nodes():
    previous, current = None, submap(0, 0)
    for k in range(NUM_NODES):
        if k and k % NODES_A_SUBMAP == 0:
            previous, current = current, submap(current.index + 1, k)
        done = previous if k % NODES_A_SUBMAP == NODES_A_SUBMAP - 1 else None
        submaps = (current,) if previous is None else (previous, current)
        points = walls() - true_pose(k)[:2]
        yield Node(k, 0.1 * k, local_pose(k), points, submaps, np.diag((1e4, 1e4, 1e4)), done)


def still_active(node):
    return [submap for submap in node.submaps if submap is not node.finished]


def config(**changes):
    search = {
        "every_nth_node": 1, "every_nth_well_constrained_node": 2, "min_search_batch": 1,
        "final_every_nth_node": 2, "max_closures_of_pair": 4,
    }  # fmt: skip
    search |= changes.pop("constraint_search", {})
    return GlobalSlamConfig(
        **({"optimize_every_n_nodes": 12, "num_threads": 1} | changes),
        constraint_search=ConstraintSearchConfig(**search),
    )


def run(config, **options):
    slam = GlobalSlam(config, StageTimer(), **options)
    active = ()
    for node in nodes():
        active = still_active(node)
        slam.add_node(node)
    slam.finish(active)
    slam.close()
    return slam


@pytest.fixture(scope="module")
def slam():
    return run(config())


def assert_counts_add_up(slam):
    closures, graph = slam.closures, slam.graph
    pairs = list(zip(closures.submap.tolist(), closures.node.tolist(), strict=True))
    assert len(set(pairs)) == len(pairs)
    assert sum(closures.counts().values()) == len(closures)
    fates = closures.status[closures.was_searched]
    assert closures.num_searched == sum(np.count_nonzero(fates == one) for one in Status)
    fates = closures.status[closures.found.row]
    assert closures.num_found == sum(np.count_nonzero(fates == one) for one in FATES_OF_FOUND)
    rows = graph.closure_rows[graph.kinds == ConstraintKind.LOOP_CLOSURE]
    in_graph = np.isin(closures.status, (Status.FOUND, Status.FINAL))
    assert sorted(rows.tolist()) == np.flatnonzero(in_graph).tolist()
    assert graph.num_loop_closures == len(rows)


def test_loop_closures_remove_the_drift(slam):
    first = slam.graph.node_poses[0]
    errors = [
        np.hypot(*(np.array(relative(Pose(*first), Pose(*pose))) - true)[:2])
        for pose, true in zip(
            slam.graph.node_poses.tolist(),
            (np.array(relative(true_pose(0), true_pose(k))) for k in range(NUM_NODES)),
            strict=True,
        )
    ]
    assert max(errors) < 0.25 * DRIFT_M * NUM_NODES
    assert NUM_NODES // 12 + 1 + 2 <= len(slam.adjustments) <= NUM_NODES // 12 + 1 + 2 + 4


def test_every_pair_has_one_row_and_one_fate(slam):
    counts = slam.closures.counts()
    assert counts[Status.FINAL] > 20
    assert slam.closures.num_found > 10
    assert counts[Status.WAITING] == counts[Status.FOUND] == 0
    assert_counts_add_up(slam)


def test_the_graph_holds_the_final_measurements(slam):
    final, graph = slam.closures.with_status(Status.FINAL), slam.graph
    order = np.argsort(graph.closure_rows[graph.closure_rows >= 0])
    measured = graph.relative_poses[graph.closure_rows >= 0][order]
    np.testing.assert_array_equal(final.tf_submap_node, measured)
    informations = graph.informations[graph.closure_rows >= 0][order]
    np.testing.assert_allclose(final.information, informations)


def test_found_closures_reached_their_threshold(slam):
    found = slam.closures.found
    assert (found.score >= slam.closures.min_score[found.row]).all()
    assert (slam.closures.found_at[found.row] >= slam.closures.requested_at[found.row]).all()


def test_the_result_does_not_depend_on_the_threads(slam):
    other = run(config(num_threads=4))

    assert other.graph.node_poses.tobytes() == slam.graph.node_poses.tobytes()
    for name, column in slam.closures.stored().items():
        assert other.closures.stored()[name].tobytes() == column.tobytes(), name


def test_closures_that_others_contradict_are_removed(monkeypatch):
    match_again = refinement.match_again

    def one_is_wrong(submap, *rest):
        matches = match_again(submap, *rest)
        if submap.index == 0:
            fits = np.flatnonzero(matches.reason == Reason.FITS)
            matches.tf_submap_node[fits[0], 0] += 1.0
        return matches

    monkeypatch.setattr(refinement, "match_again", one_is_wrong)
    slam = run(config(constraint_search={"final_passes": 1}))

    removed = slam.closures.with_status(Status.CONTRADICTED)
    assert removed.submap.tolist() == [0]
    assert removed.row[0] not in slam.graph.closure_rows
    assert_counts_add_up(slam)


def test_without_a_last_pass_closures_stay_as_found():
    slam = run(config(constraint_search={"final_passes": 0}))

    assert slam.graph.num_loop_closures == slam.closures.num_found > 0
    assert not slam.closures.has_final_match.any()
    assert_counts_add_up(slam)


def test_a_run_stopped_in_the_last_pass_keeps_its_closures(monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(refinement, "match_again", stopped)
    slam = GlobalSlam(config(), StageTimer())
    for node in nodes():
        slam.add_node(node)
    with pytest.raises(KeyboardInterrupt):
        slam.finish(still_active(node))
    slam.close()

    assert slam.graph.num_loop_closures == slam.closures.num_found > 0
    assert_counts_add_up(slam)


def test_live_requests_beyond_the_backlog_are_dropped():
    slam = run(
        config(max_live_backlog=0, constraint_search={"final_passes": 0}), wait_for_searches=False
    )

    assert slam.closures.num_dropped == slam.closures.num_requested > 0
    assert slam.closures.num_searched == slam.graph.num_loop_closures == 0
    assert_counts_add_up(slam)


def test_loop_closure_can_be_switched_off():
    slam = run(config(optimize_every_n_nodes=0))

    assert len(slam.closures) == 0
    assert slam.adjustments == []
