# SPDX-License-Identifier: Apache-2.0
"""What scans show of a map that has changed, against sets of cells."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.map_changes import LookGrids, LookLimits, note_look
from tests.reference.naive_map_changes import Looks


def new_looks(shape):
    return LookGrids(
        np.zeros(shape, np.int32), *(np.zeros(shape, np.uint16) for _ in range(3)),
        np.zeros(shape, np.int8), np.zeros(shape), np.zeros(shape),
    )  # fmt: skip


def limits(reach=1.5, offset=0.5, slope=0.01, max_tolerance=4.0, max_balance=2):
    return LookLimits(150, 80, reach, offset, slope, max_tolerance, 2.0, max_balance)


@settings(deadline=None, max_examples=80)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 5))
def test_looks_count_as_sets_of_cells_do(seed, count):
    rng = np.random.default_rng(seed)
    cells = rng.integers(1, 80, rng.integers(1, 40, 2), dtype=np.uint8)
    for _ in range(4):
        row, col = (int(rng.integers(0, edge)) for edge in cells.shape)
        cells[row : row + int(rng.integers(1, 4)), col : col + int(rng.integers(1, 12))] = 200
    cells[rng.random(cells.shape) < 0.02] = 0
    cells[rng.random(cells.shape) < 0.02] = 120
    looks, naive = new_looks(cells.shape), Looks()
    for number in range(1, count + 1):
        given_limits = limits(*rng.uniform((0.0, 0.0, 0.0), (2.0, 1.5, 0.1)))
        start = rng.uniform(-5.0, 45.0, 2)
        ends = rng.uniform(-5.0, 45.0, (int(rng.integers(0, 30)), 2))

        note_look(cells, given_limits, *start.tolist(), ends, number, 0.1 * number, looks)
        naive.add(cells, given_limits, start.tolist(), ends.tolist(), 0.1 * number)

    for name in ("shown", "denied", "ends", "balance", "first", "last"):
        expected = np.zeros(cells.shape)
        for cell, value in getattr(naive, name).items():
            expected[cell] = value
        assert np.array_equal(getattr(looks, name), expected), name


def test_a_wall_is_passed_through_only_across_it():
    cells = np.full((60, 60), 20, dtype=np.uint8)
    cells[:, 30:32] = 200
    looks = new_looks(cells.shape)

    note_look(cells, limits(), 5.0, 30.0, np.array([(55.0, 30.0)]), 1, 0.0, looks)
    assert looks.shown[30, 30:32].tolist() == [1, 1]
    assert looks.denied[30, 20] == 1
    assert looks.ends[30, 55] == 1

    along = new_looks(cells.shape)
    note_look(cells, limits(), 29.0, 2.0, np.array([(31.0, 50.0)]), 1, 0.0, along)
    assert not along.shown[:, 30:32].any()


def test_beams_that_may_end_anywhere_say_nothing():
    cells = np.full((60, 60), 20, dtype=np.uint8)
    looks = new_looks(cells.shape)

    uncertain = limits(slope=0.2)
    note_look(cells, uncertain, 5.0, 30.0, np.array([(55.0, 30.0)]), 1, 0.0, looks)

    assert not looks.shown.any()
    assert not looks.denied.any()
