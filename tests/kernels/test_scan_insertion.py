# SPDX-License-Identifier: Apache-2.0
"""The cells of a scan with its walls: the same as by one kernel after the other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.kernels.behind_walls import points_behind_walls
from cartoloop.kernels.ray_casting import scan_cells
from cartoloop.kernels.scan_insertion import cells_with_walls
from cartoloop.kernels.wall_joints import wall_joints

RESOLUTION, STRAIGHTNESS = 0.05, 0.9


def cells_by_steps(x, y, returns, misses, max_gap, reach, uncertain):
    """What one kernel after the other makes of a scan."""
    behind = np.empty((0, 2))
    if reach > 0.0:
        behind = points_behind_walls(x, y, returns, reach, STRAIGHTNESS, RESOLUTION)
    if max_gap > 0.0:
        joints = wall_joints(returns, max_gap, STRAIGHTNESS, RESOLUTION)
        returns = np.concatenate((returns, joints))
    return scan_cells(x, y, returns, misses, behind, RESOLUTION, *uncertain)


@pytest.mark.parametrize("max_gap", [0.0, 0.5])
@pytest.mark.parametrize("reach", [0.0, 0.3])
@given(
    st.integers(0, 1000),
    st.integers(0, 90),
    st.integers(0, 9),
    st.tuples(st.floats(0.0, 0.1), st.floats(0.0, 0.05)),
)
def test_walls_are_added_to_the_cells_of_a_scan(
    max_gap, reach, seed, num_returns, num_misses, uncertain
):
    rng = np.random.default_rng(seed)
    angles = np.linspace(-1.5, 1.5, num_returns)
    ranges = 3.0 / np.maximum(np.cos(angles), 0.3) + rng.normal(0.0, 0.02, num_returns)
    returns = np.column_stack((ranges * np.cos(angles), ranges * np.sin(angles)))
    misses = rng.normal(0.0, 3.0, (num_misses, 2))
    walls = max_gap, STRAIGHTNESS, reach, STRAIGHTNESS
    found = cells_with_walls(0.1, -0.2, returns, misses, RESOLUTION, *walls, *uncertain)
    expected = cells_by_steps(0.1, -0.2, returns, misses, max_gap, reach, uncertain)
    for one, other in zip(found, expected, strict=True):
        assert np.array_equal(one, other)
