# SPDX-License-Identifier: Apache-2.0
"""Agreement of returns with a submap, against looking at all its walls."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.map_agreement import (
    AgreementLimits,
    CellGrid,
    ShiftWindow,
    best_shifts,
    count_agreement,
    count_along,
)
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.sensor.scan_points import ScanPoints
from tests.reference import naive_map_agreement as naive

ORIGIN, RESOLUTION = (-0.7, 0.2), 0.05
LIMITS = AgreementLimits(wall=150, floor=80, on_wall=2, off_wall=4, max_range=2.0)
SEEDS = st.integers(0, 2**32 - 1)


def random_cells(rng):
    cells = rng.integers(0, 80, rng.integers(1, 60, 2), dtype=np.uint8)
    cells[rng.random(cells.shape) < 0.02] = 200
    cells[rng.random(cells.shape) < 0.02] = 0
    return cells


@settings(deadline=None, max_examples=60)
@given(seed=SEEDS, count=st.integers(0, 4))
def test_returns_are_on_walls_on_floor_or_not_counted(seed, count):
    rng = np.random.default_rng(seed)
    cells = random_cells(rng)
    scans = [rng.uniform(-2.0, 2.0, (int(rng.integers(0, 40)), 2)) for _ in range(count)]
    poses = rng.uniform(-1.0, 1.0, (count, 3))
    batch, counts = ScanPoints.of(scans), np.full((count, 2), -1, dtype=np.int64)

    count_agreement(
        CellGrid(cells, *ORIGIN, RESOLUTION), LIMITS,
        ScanBatch(batch.points, batch.firsts, batch.ends), poses, counts,
    )  # fmt: skip

    expected = [
        naive.agreement(cells, ORIGIN, RESOLUTION, LIMITS, points, pose)
        for points, pose in zip(scans, poses, strict=True)
    ]
    assert counts.tolist() == [list(pair) for pair in expected]


@settings(deadline=None, max_examples=30)
@given(seed=SEEDS)
def test_best_shifts_are_those_of_an_exhaustive_search(seed):
    rng = np.random.default_rng(seed)
    cells = random_cells(rng)
    window = ShiftWindow(steps=3, step_cells=2, turns=1, turn=0.05, near_steps=1)
    groups = [rng.uniform(-1.0, 2.5, (int(rng.integers(1, 80)), 2)) for _ in range(3)]
    batch, shifts = ScanPoints.of(groups), np.empty((3, 5))

    best_shifts(
        CellGrid(cells, *ORIGIN, RESOLUTION), 150, window,
        batch.points, batch.firsts, batch.ends, shifts,
    )  # fmt: skip

    for group, (near, fitting, *shift) in zip(groups, shifts.tolist(), strict=True):
        expected = naive.best_shift(cells, ORIGIN, RESOLUTION, 150, window, group)
        assert (near, fitting) == expected[:2]
        assert shift == pytest.approx(expected[2:])


@settings(deadline=None, max_examples=30)
@given(seed=SEEDS)
def test_fits_along_a_direction_are_counted(seed):
    rng = np.random.default_rng(seed)
    cells = random_cells(rng)
    angles = rng.uniform(-math.pi, math.pi, 3)
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    shifts = rng.uniform(-2.0, 2.0, int(rng.integers(0, 6)))
    groups = [rng.uniform(-1.0, 2.5, (int(rng.integers(0, 12)), 2)) for _ in range(3)]
    batch, counts = ScanPoints.of(groups), np.full((3, len(shifts)), -1, dtype=np.int64)

    count_along(
        CellGrid(cells, *ORIGIN, RESOLUTION), 150,
        batch.points, batch.firsts, batch.ends, directions, shifts, counts,
    )  # fmt: skip

    for group, direction, found in zip(groups, directions, counts.tolist(), strict=True):
        assert found == naive.fits_along(
            cells, ORIGIN, RESOLUTION, 150, group, direction, shifts.tolist()
        )


def test_a_displaced_wall_is_found_where_it_is():
    cells = np.full((60, 60), 20, dtype=np.uint8)
    cells[40, :] = cells[:, 10] = 200
    along = np.linspace(0.8, 2.0, 30)
    wall = np.column_stack((along, np.full(30, 40 * 0.05 - 0.5)))
    side = np.column_stack((np.full(30, 0.5 + 0.3), np.linspace(0.2, 1.4, 30)))
    shifts = np.empty((1, 5))
    window = ShiftWindow(steps=10, step_cells=2, turns=0, turn=0.0, near_steps=1)

    best_shifts(
        CellGrid(cells, 0.0, 0.0, 0.05), 150, window, np.concatenate((wall, side)),
        np.array([0]), np.array([60]), shifts,
    )  # fmt: skip

    near, fitting, x, y, turn = shifts[0].tolist()
    assert near < 20
    assert fitting == 60
    assert (x, y) == pytest.approx((-0.3, 0.5), abs=0.1)
    assert math.isclose(turn, 0.0)
