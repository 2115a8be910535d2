# SPDX-License-Identifier: Apache-2.0
"""Straight walls, against looking at each line through each cell."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation

from cartoloop.kernels.straight_walls import mark_straight_walls

WALL, HALF_LENGTH = 150, 4
HEADINGS = np.array([(math.cos(a), math.sin(a)) for a in np.arange(8) * math.pi / 8])


def marked(cells):
    straight = np.full(cells.shape, 9, dtype=np.uint8)
    mark_straight_walls(cells, WALL, HALF_LENGTH, HEADINGS, straight)
    return straight


def looked_at(cells):
    near = binary_dilation(cells >= WALL, np.ones((3, 3)))
    straight = np.zeros(cells.shape, dtype=np.uint8)
    for row, col in np.argwhere(cells >= WALL):
        for along_cols, along_rows in HEADINGS:
            line = [
                (math.floor(row + s * along_rows + 0.5), math.floor(col + s * along_cols + 0.5))
                for s in range(-HALF_LENGTH, HALF_LENGTH + 1)
            ]
            inside = all(0 <= i < cells.shape[0] and 0 <= j < cells.shape[1] for i, j in line)
            if inside and all(near[place] for place in line):
                straight[row, col] = 1
    return straight


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_lines_are_followed_as_one_by_one(seed):
    rng = np.random.default_rng(seed)
    cells = np.zeros(rng.integers(1, 30, 2), dtype=np.uint8)
    cells[rng.random(cells.shape) < rng.uniform(0.0, 0.4)] = 200

    assert np.array_equal(marked(cells), looked_at(cells))


def test_walls_are_straight_between_their_ends_and_boxes_never():
    cells = np.zeros((40, 40), dtype=np.uint8)
    cells[5, 5:25] = 200
    cells[30:34, 30:34] = 200

    straight = marked(cells)

    assert straight[5, 9:21].all()
    assert not straight[5, 5:8].any()
    assert not straight[30:34, 30:34].any()
