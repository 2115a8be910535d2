# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/map_composition.py."""

from __future__ import annotations

import math

import numpy as np


def naive_cell_evidence(cells, log_odds):
    """Return each cell's log-odds, but nothing for free cells beside one that was hit."""
    evidence = log_odds[cells]
    hit = np.pad(evidence > 0, 1)
    rows, cols = cells.shape
    beside_hit = np.zeros(cells.shape, bool)
    for row in range(rows):
        for col in range(cols):
            beside_hit[row, col] = hit[row : row + 3, col : col + 3].any()
    return np.where(beside_hit & (evidence < 0), 0.0, evidence)


def naive_add_submap(cells, evidence, affine, total, known):
    """Add evidence to `total` and `known` at every map cell, asking each submap cell by itself."""

    def value(array, row, col):
        inside = 0 <= row < cells.shape[0] and 0 <= col < cells.shape[1]
        return array[row, col] if inside else 0

    for row in range(total.shape[0]):
        for col in range(total.shape[1]):
            u = affine[0] + affine[1] * col + affine[2] * row
            v = affine[3] + affine[4] * col + affine[5] * row
            left, below = math.floor(u), math.floor(v)
            if value(cells, math.floor(v + 0.5), math.floor(u + 0.5)) == 0:
                continue
            total[row, col] += sum(
                (1 - abs(u - neighbour_u))
                * (1 - abs(v - neighbour_v))
                * value(evidence, neighbour_v, neighbour_u)
                for neighbour_u in (left, left + 1)
                for neighbour_v in (below, below + 1)
            )
            known[row, col] = True
