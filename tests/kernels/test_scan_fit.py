# SPDX-License-Identifier: Apache-2.0
"""Agreement of the beams of a scan with a map, against following each of them."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.map_agreement import CellGrid
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.kernels.scan_fit import (
    BEHIND_WALL,
    ON_FLOOR,
    ON_STRAIGHT_WALL,
    ON_WALL,
    ON_WALL_BEHIND,
    SEEN_THROUGH,
    STRAIGHT,
    FitLimits,
    count_fit,
    count_passes,
)
from cartoloop.sensor.scan_points import ScanPoints
from tests.reference import naive_scan_fit as naive

ORIGIN, RESOLUTION = (-0.7, 0.2), 0.05
LIMITS = FitLimits(wall=150, floor=80, on_wall=2, off_wall=4, clearance=3.5, max_range=2.0)


def counts_of(cells, marks, scans, origins, poses):
    batch, counts = ScanPoints.of(scans), np.full((len(scans), 5), -1, dtype=np.int64)
    count_fit(
        CellGrid(cells, *ORIGIN, RESOLUTION), marks, LIMITS,
        ScanBatch(batch.points, batch.firsts, batch.ends), origins, poses, counts,
    )  # fmt: skip
    return counts


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 4))
def test_beams_end_and_are_blocked_as_followed_one_by_one(seed, count):
    rng = np.random.default_rng(seed)
    cells = rng.integers(0, 80, rng.integers(1, 60, 2), dtype=np.uint8)
    cells[rng.random(cells.shape) < 0.01] = 200
    cells[rng.random(cells.shape) < 0.02] = 0
    marks = rng.integers(0, 4, cells.shape, dtype=np.uint8)
    scans = [rng.uniform(-2.0, 2.0, (int(rng.integers(0, 40)), 2)) for _ in range(count)]
    origins, poses = rng.uniform(-0.3, 0.3, (count, 2)), rng.uniform(-1.0, 1.0, (count, 3))

    counts = counts_of(cells, marks, scans, origins, poses)

    assert counts.tolist() == [
        naive.fit(cells, marks, ORIGIN, RESOLUTION, LIMITS, points, origin, pose)
        for points, origin, pose in zip(scans, origins, poses, strict=True)
    ]


def test_a_return_is_on_a_wall_on_floor_or_behind_a_wall():
    cells = np.full((60, 60), 20, dtype=np.uint8)
    cells[:, 40] = 200  # at x = 1.3 m
    marks = np.zeros_like(cells)
    marks[:20] = STRAIGHT  # up to y = 1.15 m
    cells[10, 51] = 200  # at (1.85, 0.7)
    points = np.array(((1.3, 0.5), (1.3, 1.5), (0.5, 0.5), (1.8, 0.3), (1.85, 0.7)))

    counts = counts_of(cells, marks, [points], np.array(((0.0, 0.5),)), np.zeros((1, 3)))[0]

    assert (counts[ON_WALL], counts[ON_FLOOR], counts[BEHIND_WALL]) == (2, 1, 2)
    assert (counts[ON_STRAIGHT_WALL], counts[ON_WALL_BEHIND]) == (1, 1)


def test_a_wall_that_is_seen_through_blocks_no_beam():
    cells = np.full((60, 60), 20, dtype=np.uint8)
    cells[:, 30] = cells[:, 50] = 200  # at x = 0.8 m and 1.8 m
    marks = np.zeros_like(cells)
    marks[:, 30] = SEEN_THROUGH

    counts = counts_of(
        cells, marks, [np.array(((1.8, 0.5),))], np.array(((0.0, 0.5),)), np.zeros((1, 3))
    )[0]

    assert (counts[ON_WALL], counts[BEHIND_WALL]) == (1, 0)


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 4))
def test_passes_are_those_of_beams_followed_one_by_one(seed, count):
    rng = np.random.default_rng(seed)
    cells = rng.integers(0, 80, rng.integers(1, 60, 2), dtype=np.uint8)
    cells[rng.random(cells.shape) < 0.1] = 200
    scans = [rng.uniform(-2.0, 2.0, (int(rng.integers(0, 20)), 2)) for _ in range(count)]
    origins, poses = rng.uniform(-0.3, 0.3, (count, 2)), rng.uniform(-1.0, 1.0, (count, 3))
    batch, passes = ScanPoints.of(scans), np.zeros(cells.shape, dtype=np.int64)

    count_passes(
        CellGrid(cells, *ORIGIN, RESOLUTION), LIMITS,
        ScanBatch(batch.points, batch.firsts, batch.ends), origins, poses, passes,
    )  # fmt: skip

    expected = np.zeros_like(passes)
    for points, origin, pose in zip(scans, origins, poses, strict=True):
        expected += naive.passes(cells, ORIGIN, RESOLUTION, LIMITS, points, origin, pose)
    assert np.array_equal(passes, expected)
