# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.floor_blocks import count_in_blocks, floor_in_blocks
from tests.reference.naive_floor_blocks import naive_counts, naive_floor

LIMITS = np.array((0.1, 0.3, 0.7), dtype=np.float32)
VALUES = np.array((-1.0, 0.0, 0.1, 0.2, 0.3, 0.4, 0.45, 0.5, 0.6, 1.0), dtype=np.float32)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 11), st.integers(1, 11), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_floor_of_blocks_is_that_of_their_cells(num_rows, num_cols, edge, seed):
    rng = np.random.default_rng(seed)
    probability = rng.choice(VALUES, (num_rows, num_cols))

    counts = count_in_blocks(probability, edge, LIMITS)
    kinds = rng.integers(0, 4, counts.shape[:2]).astype(np.uint8)

    assert np.array_equal(counts, naive_counts(probability, edge, LIMITS))
    found = floor_in_blocks(probability, edge, LIMITS, kinds)
    assert found == naive_floor(probability, edge, LIMITS, kinds)
