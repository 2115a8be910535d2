# SPDX-License-Identifier: Apache-2.0
"""Sums of cells at the points of scans, against looking up one after the other."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.sum_at_points import sum_at_points
from cartoloop.sensor.pose import Pose, compose
from cartoloop.sensor.scan_points import ScanPoints

LEAST, ORIGIN_X, ORIGIN_Y, RESOLUTION = 3, -0.7, 0.2, 0.05


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 4))
def test_each_point_adds_its_cell(seed, count):
    rng = np.random.default_rng(seed)
    cells = rng.integers(0, 256, rng.integers(1, 30, 2), dtype=np.uint8)
    scans = [rng.uniform(-1.0, 1.5, (int(rng.integers(0, 20)), 2)) for _ in range(count)]
    poses = rng.uniform(-1.0, 1.0, (count, 3))
    expected = 0
    for scan, pose in zip(scans, poses, strict=True):
        for point in scan:
            x, y, _ = compose(Pose(*pose), Pose(*point, 0.0))
            col = math.floor((x - ORIGIN_X) / RESOLUTION + 0.5)
            row = math.floor((y - ORIGIN_Y) / RESOLUTION + 0.5)
            is_inside = 0 <= row < cells.shape[0] and 0 <= col < cells.shape[1]
            expected += max(LEAST, int(cells[row, col])) if is_inside else LEAST
    together = ScanPoints.of(scans)

    total = sum_at_points(
        cells, LEAST, ORIGIN_X, ORIGIN_Y, RESOLUTION, together.points, together.firsts,
        together.ends, poses,
    )  # fmt: skip

    assert total == expected
