# SPDX-License-Identifier: Apache-2.0
"""Many scans matched to one grid: each as if it were alone, and those that cannot fit left."""

from __future__ import annotations

import numpy as np

from cartoloop.kernels.match_batch import match_all_least_squares
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.kernels.scan_residuals import MatchOptions, MotionPrior, match_least_squares
from cartoloop.kernels.smooth_map import SmoothMap
from tests.reference.naive_scan_residuals import naive_smooth_probability

UNKNOWN = 0.1


def some_grid(seed, shape=(24, 30)):
    return np.random.default_rng(seed).uniform(0.1, 0.9, shape).astype(np.float32)


def squares_one_by_one(grid, points, pose):
    """The sum over all points, by the naive map."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    total = 0.0
    for x, y in points.tolist():
        col = (pose[0] + cos * x - sin * y) / 0.05
        row = (pose[1] + sin * x + cos * y) / 0.05
        total += (1.0 - naive_smooth_probability(grid, UNKNOWN, col, row)) ** 2
    return total


def test_each_scan_is_matched_as_if_it_were_alone_or_left():
    rng = np.random.default_rng(3)
    grid = some_grid(3)
    scans = [rng.uniform(-0.5, 0.5, (k, 2)) for k in (5, 12, 30)]
    starts = np.column_stack((rng.uniform(0.3, 1.0, (3, 2)), rng.uniform(-1, 1, 3)))
    information = np.array((100.0, 0.0, 0.0, 100.0, 0.0, 50.0))
    residuals = [
        np.sqrt(squares_one_by_one(grid, scan, pose) / len(scan))
        for scan, pose in zip(scans, starts.tolist(), strict=True)
    ]
    limit = float(np.median(residuals)) + 1e-6
    found = np.empty((3, 11))
    smooth_map, options = SmoothMap(grid, 0.0, 0.0, 0.05), MatchOptions(10.0, 20, 1e-5)
    batch = ScanBatch(np.concatenate(scans), np.array((0, 5, 17)), np.array((5, 17, 47)))
    match_all_least_squares(
        smooth_map, UNKNOWN, batch, starts, information, 1e6, options, limit, found
    )
    assert sum(np.isinf(found[:, 9])) == 1
    for scan, start, residual, row in zip(scans, starts, residuals, found, strict=True):
        if residual > limit:
            np.testing.assert_array_equal(row[:3], start)
            np.testing.assert_array_equal(row[3:9], 0.0)
            continue
        alone = np.empty(11)
        match_least_squares(
            smooth_map,
            UNKNOWN,
            scan,
            start,
            MotionPrior(start, information, 1e6),
            options,
            np.inf,
            alone,
        )
        np.testing.assert_array_equal(row, alone)
