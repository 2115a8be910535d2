# SPDX-License-Identifier: Apache-2.0
"""Which nodes the last pass matches to which submaps, and what it accepts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.refinement import (
    final_limits,
    in_nearest_submaps,
    match_again,
    overlapping_nodes,
    why_not_matched,
)
from cartoloop.sensor.pose import Pose, relative
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid
from tests.global_slam.closures import closure, record

CONFIG = ConstraintSearchConfig()


def poses(rng, count):
    return np.column_stack((rng.uniform(-6, 6, (count, 2)), rng.uniform(-3, 3, count)))


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), every=st.integers(1, 3))
def test_nodes_inside_the_grid_overlap_a_submap(seed, every):
    rng = np.random.default_rng(seed)
    height, width = rng.integers(1, 90, 2)
    grid = FinishedGrid(np.ones((height, width), np.uint8), -3.0, -1.0, 0.1)
    submap = FinishedSubmap(int(rng.integers(5)), grid, 0.9)
    node_poses, inserted = poses(rng, 60), set(rng.integers(0, 60, 9).tolist())
    [tf_map_submap] = poses(rng, 1)
    expected = []
    for node in range(60):
        x, y, _ = relative(Pose(*tf_map_submap), Pose(*node_poses[node]))
        inside = 0 < x + 3.0 < width * 0.1 and 0 < y + 1.0 < height * 0.1
        if inside and node not in inserted and (node + submap.index) % every == 0:
            expected.append(node)
    found = overlapping_nodes(submap, tf_map_submap, node_poses, inserted, every)
    assert found.tolist() == expected


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), limit=st.integers(1, 5))
def test_a_node_keeps_its_nearest_submaps(seed, limit):
    rng = np.random.default_rng(seed)
    submap_poses, node_poses = poses(rng, int(rng.integers(1, 8))), poses(rng, 12)
    submap_poses[-1] = submap_poses[0]  # as near as another one
    overlapping = [np.flatnonzero(rng.random(12) < 0.6) for _ in submap_poses]

    kept = in_nearest_submaps(overlapping, submap_poses, node_poses, limit)

    for node in range(12):
        submaps = [i for i, nodes in enumerate(overlapping) if node in nodes]
        submaps.sort(key=lambda i: np.hypot(*(node_poses[node] - submap_poses[i])[:2]))
        assert [i for i, nodes in enumerate(kept) if node in nodes] == sorted(submaps[:limit])
    assert all((np.diff(nodes) > 0).all() for nodes in kept)


def test_found_closures_not_matched_again_have_a_reason():
    found = record(found=[closure(0, node) for node in (2, 3, 4, 6, 8)]).found
    overlapping, selected = [np.array((2, 4, 6))], [np.array((2, 4))]
    assert why_not_matched(found, overlapping, selected, every=2).tolist() == [
        Reason.START_RESIDUAL, Reason.EVERY_NTH_NODE, Reason.START_RESIDUAL, Reason.NEARER_SUBMAPS,
        Reason.NO_OVERLAP,
    ]  # fmt: skip


def wall_and_nodes():
    """A submap of a corner, and a node in it whose returns lie on its walls."""
    cells = np.full((60, 60), 40, np.uint8)
    cells[10] = cells[:, 10] = 250
    submap = FinishedSubmap(3, FinishedGrid(cells, 0.0, 0.0, 0.05), 0.6)
    along = np.linspace(0.6, 2.8, 45)
    wall = np.full(45, 0.5)
    points = np.concatenate((np.column_stack((along, wall)), np.column_stack((wall, along))))
    return submap, points - 1.5


def test_submaps_of_sparse_scans_may_fit_worse():
    submap, _ = wall_and_nodes()
    sparse = FinishedSubmap(3, submap.grid, submap.own_score, is_sparse=True)
    config = CONFIG.model_copy(update={"min_score": 0.0, "sparse_residual": 0.15})
    usual = final_limits(config, submap).residual
    assert final_limits(config, sparse).residual == pytest.approx(usual + 0.15)


def matches_at(poses, config=CONFIG):
    submap, points = wall_and_nodes()
    node_poses = np.array(poses, dtype=np.float64)
    scans = ScanPoints.of([points] * len(node_poses))
    return match_again(submap, np.zeros(3), np.arange(len(poses)), node_poses, scans, config)


def test_a_match_near_the_adjusted_pose_fits():
    matches = matches_at([(1.52, 1.49, 0.005)])

    assert matches.reason.tolist() == [Reason.FITS]
    assert np.abs(matches.tf_submap_node - (1.5, 1.5, 0.0)).max() < 0.02
    assert matches.moved_m[0] < 0.05
    assert matches.information[0, 0, 0] > 0.0


def test_each_limit_of_the_last_pass_has_its_reason():
    start = [(1.55, 1.5, 0.0)]
    assert (
        matches_at(start, CONFIG.model_copy(update={"max_start_residual": 0.01})).reason.size == 0
    )
    for name, reason in (
        ("max_refined_residual", Reason.RESIDUAL),
        ("max_refinement", Reason.TRANSLATION),
    ):
        limited = CONFIG.model_copy(update={name: 1e-6, "min_score": 0.0})
        assert matches_at(start, limited).reason.tolist() == [reason]
