# SPDX-License-Identifier: Apache-2.0
"""Where parts hold together, and by how far they may be displaced elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.global_slam.following import WINDOW_M
from cartoloop.global_slam.join_evidence import TwoParts
from cartoloop.global_slam.part_drift import DRIFT_SHARE, Drift, drift_of, held_at
from cartoloop.global_slam.pose_graph import ClosureConstraints, ConstraintKind, PoseGraph
from cartoloop.sensor.scan_points import ScanPoints


def connected(*closures):
    """Return three parts of a submap each at the origin, the last is left out.

    The nodes of part k are 10 k m along x, and 1 m apart along y.

    Parameters
    ----------
    closures : submap, node and by how much the match disagrees with the poses [m].
    """
    graph = PoseGraph()
    for _ in range(3):
        graph.add_submap((0.0, 0.0, 0.0))
    poses = np.array([(10.0 * part, float(i), 0.0) for part in range(3) for i in range(4)])
    graph.add_nodes([tuple(pose) for pose in poses.tolist()])
    submaps, nodes, errors = (np.array(column) for column in zip(*closures, strict=True))
    matches = poses[nodes.astype(np.int64)] + errors[:, np.newaxis] * (1.0, 0.0, 0.0)
    count = len(closures)
    graph.add_loop_closures(
        ClosureConstraints(
            np.arange(count),
            submaps.astype(np.int64),
            nodes.astype(np.int64),
            matches,
            np.tile(np.eye(3), (count, 1, 1)),
        )
    )
    for part in range(3):
        graph.add_constraints(
            ConstraintKind.INTRA_SUBMAP,
            [part] * 4,
            range(4 * part, 4 * part + 4),
            [(0.0, 0.0, 0.0)] * 4,
            [np.eye(3)] * 4,
        )
    of_nodes = np.repeat((0, 1, -1), 4)
    return TwoParts(graph, [], ScanPoints.of([]), of_nodes, np.array((0, 1, -1)))


def test_parts_hold_where_closures_connect_them():
    within, left_out = [(0, 1, 0.0), (1, 5, 0.0)], [(2, 0, 0.0), (0, 9, 0.0)]
    between = [(0, 6, 0.05), (1, 2, 0.0)]
    held = held_at(connected(*within, *left_out, *between))
    assert held.tolist() == [[10.0, 2.0], [0.0, 2.0]]


def test_closures_that_the_poses_contradict_hold_nothing():
    held = held_at(connected((0, 6, 0.05), (0, 7, 1.5)))
    assert held.tolist() == [[10.0, 2.0]]


@pytest.mark.parametrize("closures", [[(0, 6, 0.0)], [(0, 6, 0.0), (0, 7, 1.5)]])
def test_drift_grows_along_the_path_from_what_holds(closures):
    drift = drift_of(connected(*closures))
    # Submap 0 holds, and so all of its nodes do; of the other part, node 6.
    np.testing.assert_allclose(
        drift.of_nodes, DRIFT_SHARE * np.array([0, 0, 0, 0, 2, 1, 0, 1] + [0] * 4)
    )
    np.testing.assert_allclose(drift.of_submaps, 0.0)


def test_both_ends_of_a_pair_drift():
    drift = Drift(np.array([0.5, 9.0]), np.array([0.0, 0.25]))
    assert drift.between(np.array([0, 1]), 1).tolist() == [0.75, WINDOW_M]


def test_path_counts_where_a_session_comes_by_again():
    # 40 nodes along a path of 39 m that comes back to where it began; the last one holds.
    graph = PoseGraph()
    for _ in range(5):
        graph.add_submap((0.0, 0.0, 0.0))
    there = [(float(min(i, 39 - i)), 0.0, 0.0) for i in range(40)]
    graph.add_nodes([*there, (0.0, 0.0, 0.0)])
    for submap in range(4):
        nodes = range(max(10 * submap - 5, 0), 10 * submap + 10)
        own = [(0.0, 0.0, 0.0)] * len(nodes), [np.eye(3)] * len(nodes)
        graph.add_constraints(ConstraintKind.INTRA_SUBMAP, [submap] * len(nodes), nodes, *own)
    graph.add_constraints(ConstraintKind.INTRA_SUBMAP, [4], [40], [(0.0, 0.0, 0.0)], [np.eye(3)])
    graph.add_loop_closures(
        ClosureConstraints(
            np.zeros(1, np.int64),
            np.array([4]),
            np.array([39]),
            np.array([there[39]]),
            np.eye(3)[np.newaxis],
        )
    )
    of_nodes, of_submaps = np.repeat((0, 1), (40, 1)), np.repeat((0, 1), (4, 1))
    drift = drift_of(TwoParts(graph, [], ScanPoints.of([]), of_nodes, of_submaps))
    assert drift.of_nodes[[39, 30, 0]] == pytest.approx(DRIFT_SHARE * np.array([0.0, 9.0, 38.0]))
    assert drift.of_submaps[[0, 4]] == pytest.approx(DRIFT_SHARE * np.array([29.0, 0.0]))


def test_parts_that_nothing_holds_do_not_drift():
    drift = drift_of(connected((0, 7, 1.5)))
    assert not drift.of_nodes.any()
    assert not drift.of_submaps.any()
