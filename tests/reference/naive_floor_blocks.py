# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/floor_blocks.py."""

from __future__ import annotations

import numpy as np


def _counting(probability, limit):
    """Return which cells are walls, or free by a limit."""
    return (probability >= 0.0) & ((probability < limit) | (probability > 0.5))


def naive_counts(probability, edge, limits):
    """Count cell by cell in each block."""
    rows, cols = probability.shape
    counts = np.zeros((-(-rows // edge), -(-cols // edge), len(limits)), dtype=np.int64)
    for k, limit in enumerate(limits):
        for row, col in np.argwhere(_counting(probability, limit)):
            counts[row // edge, col // edge, k] += 1
    return counts


def naive_floor(probability, edge, limits, kinds):
    """Return the number of free cells in blocks that count, and the box around what counts."""
    rows, cols = probability.shape
    kind = np.repeat(np.repeat(kinds, edge, axis=0), edge, axis=1)[:rows, :cols]
    free = (probability >= 0.0) & (probability < limits[-1]) & (kind > 0)
    seen = np.zeros(probability.shape, dtype=bool)
    for k, limit in enumerate(limits):
        seen |= (kind == k + 1) & _counting(probability, limit)
    places = np.argwhere(seen)
    box = (rows, cols, -1, -1)
    if len(places):
        box = (*places.min(axis=0).tolist(), *places.max(axis=0).tolist())
    return (int(free.sum()), *box)
