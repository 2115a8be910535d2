# SPDX-License-Identifier: Apache-2.0
"""Agreement of the beams of a scan with a map, against following each of them."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.map_agreement import CellGrid
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.kernels.scan_fit import BEHIND_WALL, ON_FLOOR, ON_WALL, FitLimits, count_fit
from cartoloop.sensor.scan_points import ScanPoints
from tests.reference import naive_scan_fit as naive

ORIGIN, RESOLUTION = (-0.7, 0.2), 0.05
LIMITS = FitLimits(wall=150, floor=80, on_wall=2, off_wall=4, clearance=3.5, max_range=2.0)


def counts_of(cells, scans, origins, poses):
    batch, counts = ScanPoints.of(scans), np.full((len(scans), 3), -1, dtype=np.int64)
    count_fit(
        CellGrid(cells, *ORIGIN, RESOLUTION), LIMITS,
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
    scans = [rng.uniform(-2.0, 2.0, (int(rng.integers(0, 40)), 2)) for _ in range(count)]
    origins, poses = rng.uniform(-0.3, 0.3, (count, 2)), rng.uniform(-1.0, 1.0, (count, 3))

    counts = counts_of(cells, scans, origins, poses)

    assert counts.tolist() == [
        naive.fit(cells, ORIGIN, RESOLUTION, LIMITS, points, origin, pose)
        for points, origin, pose in zip(scans, origins, poses, strict=True)
    ]


def test_a_return_is_on_a_wall_on_floor_or_behind_a_wall():
    cells = np.full((60, 60), 20, dtype=np.uint8)
    cells[:, 40] = 200  # at x = 1.3 m
    points = np.array(((1.3, 0.5), (0.5, 0.5), (1.8, 0.5)))

    counts = counts_of(cells, [points], np.array(((0.0, 0.5),)), np.zeros((1, 3)))[0]

    assert (counts[ON_WALL], counts[ON_FLOOR], counts[BEHIND_WALL]) == (1, 1, 1)
