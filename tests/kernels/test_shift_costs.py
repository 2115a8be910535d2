# SPDX-License-Identifier: Apache-2.0
"""The cost of scans after shifts along a direction, without what lies on walls along it."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.kernels.shift_costs import add_shift_costs
from cartoloop.kernels.smooth_map import SmoothMap
from tests.reference.naive_shift_costs import naive_shift_costs

SHIFTS = np.array((-0.2, 0.0, 0.05, 0.4))


def some_scan(rng):
    """Points on a wall in some direction, and some others."""
    along = np.linspace(0.0, 1.5, 16)[:, None] * np.array(
        (np.cos(a := rng.uniform(-3, 3)), np.sin(a))
    )
    return np.concatenate((along + rng.uniform(-0.5, 0.5, 2), rng.uniform(-1.0, 1.0, (5, 2))))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.floats(0.0, 0.99))
def test_costs_equal_those_of_the_slow_twin(seed, count, max_parallel):
    rng = np.random.default_rng(seed)
    grid = rng.uniform(0.1, 0.9, (40, 50)).astype(np.float32)
    smooth_map = SmoothMap(grid, -0.3, -0.2, 0.05)
    scans = [some_scan(rng) for _ in range(count)]
    poses = np.column_stack((rng.uniform(0.2, 1.5, (count, 2)), rng.uniform(-4, 4, count)))
    groups, angles = rng.integers(0, 2, count), rng.uniform(-3, 3, 2)
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    ends = np.cumsum([len(scan) for scan in scans])
    batch = ScanBatch(np.concatenate(scans), np.concatenate(([0], ends[:-1])), ends)
    costs, counts = np.zeros((2, len(SHIFTS))), np.zeros(2, dtype=np.int64)

    arguments = (poses, groups, directions, SHIFTS, max_parallel)
    add_shift_costs(smooth_map, 0.1, batch, *arguments, costs, counts)

    expected = naive_shift_costs(smooth_map, 0.1, scans, *arguments)
    np.testing.assert_allclose(costs, expected[0], rtol=1e-9)
    assert counts.tolist() == expected[1].tolist()
