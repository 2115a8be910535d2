# SPDX-License-Identifier: Apache-2.0
"""The precomputed grids are the maxima that eq. (17) asks for."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cartoloop.kernels.precomputation_grid import halve, widen_boxes
from cartoloop.scan_matching.precomputation_grid import (
    BOXES,
    MAP_STRIDES,
    MARGIN,
    MAX_MOVE,
    PrecomputationGrids,
)
from tests.reference.naive_branch_and_bound import naive_boxes

GRIDS = [(stride, edge) for stride, edges in BOXES.items() for edge in edges]


def cell_arrays(max_side):
    return st.tuples(st.integers(1, max_side), st.integers(1, max_side)).flatmap(
        lambda shape: arrays(np.uint8, shape)
    )


@settings(deadline=None, max_examples=30)
@given(cell_arrays(24), st.lists(st.sampled_from(GRIDS), min_size=1, max_size=6))
def test_each_grid_equals_the_brute_force_maximum(cells, which):
    grids = PrecomputationGrids(cells, MAP_STRIDES)
    for stride, edge in which:
        grid = grids.grid(stride, edge)
        np.testing.assert_array_equal(grid, naive_boxes(cells, stride, edge, MARGIN, *grid.shape))


def test_all_grids_of_one_submap_equal_the_brute_force_maximum():
    cells = np.random.default_rng(1).integers(0, 256, (19, 33)).astype(np.uint8)
    grids = PrecomputationGrids(cells, MAP_STRIDES)
    for stride, edge in GRIDS:
        grid = grids.grid(stride, edge)
        np.testing.assert_array_equal(grid, naive_boxes(cells, stride, edge, MARGIN, *grid.shape))


def test_larger_boxes_hold_no_smaller_maxima():
    cells = np.random.default_rng(2).integers(0, 256, (40, 31)).astype(np.uint8)
    grids = PrecomputationGrids(cells, MAP_STRIDES)
    for stride, edges in BOXES.items():
        for smaller, larger in itertools.pairwise(edges):
            assert (grids.grid(stride, larger) >= grids.grid(stride, smaller)).all()


@pytest.mark.parametrize("height", range(len(MAP_STRIDES)))
def test_the_box_chosen_for_a_move_holds_block_and_move(height):
    grids = PrecomputationGrids(np.zeros((5, 7), dtype=np.uint8), MAP_STRIDES)
    stride = MAP_STRIDES[height]
    layout = grids.layouts[stride]
    for move in range(MAX_MOVE * (1 << height) + 3):
        start = grids.boxes[height, move] - MARGIN * (layout.row_length + 1) - layout.first
        number, remainder = divmod(start, layout.grid_size)
        assert remainder == 0
        edge = BOXES[stride][number]
        # The box may begin up to a stride less one cell before the block does.
        assert edge * stride - (stride - 1) >= (1 << height) + move


@given(cell_arrays(20))
@settings(deadline=None)
def test_halving_keeps_the_maximum_of_each_block(cells):
    halved = np.empty(((cells.shape[0] + 1) // 2, (cells.shape[1] + 1) // 2), dtype=np.uint8)
    halve(cells, halved)
    padded = np.pad(cells, ((0, cells.shape[0] % 2), (0, cells.shape[1] % 2)))
    expected = padded.reshape(halved.shape[0], 2, halved.shape[1], 2).max(axis=(1, 3))
    np.testing.assert_array_equal(halved, expected)


def test_widening_by_nothing_copies():
    boxes = np.arange(60, dtype=np.uint8)
    out = np.empty_like(boxes)
    widen_boxes(boxes, 0, 10, out)
    np.testing.assert_array_equal(out, boxes)


def test_memory_stays_within_14_bytes_a_pixel():
    cells = np.zeros((500, 500), dtype=np.uint8)
    assert PrecomputationGrids(cells, MAP_STRIDES).cells.nbytes < 14 * cells.size
