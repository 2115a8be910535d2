# SPDX-License-Identifier: Apache-2.0
"""Which nodes the last pass matches to which submaps."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.global_slam.finished_submap import FinishedSubmap
from cartoloop.global_slam.refinement import in_nearest_submaps, overlapping_nodes
from cartoloop.sensor.pose import Pose, relative
from cartoloop.submaps.finished_grid import FinishedGrid


def poses(rng, count):
    return np.column_stack((rng.uniform(-6, 6, (count, 2)), rng.uniform(-3, 3, count)))


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), every=st.integers(1, 3))
def test_nodes_overlap_a_submap_where_they_stand_in_its_grid_and_are_not_of_it(seed, every):
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
def test_a_node_keeps_the_submaps_that_are_nearest(seed, limit):
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
