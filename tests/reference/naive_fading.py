# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/fading.py."""

from __future__ import annotations

import math

import numpy as np


def _place(affine, row, col):
    """Row and column of another grid that a cell lies in."""
    return (
        math.floor(affine[3] + affine[4] * col + affine[5] * row),
        math.floor(affine[0] + affine[1] * col + affine[2] * row),
    )


def _is_inside(place, array):
    return all(0 <= number < size for number, size in zip(place, array.shape, strict=True))


def naive_fade(cells, affine, total, known, free_below, wall_above):
    """Return the cells that are left, those that were not seen later, and both counts."""
    faded, unseen = cells.copy(), np.zeros_like(cells)
    observed = covered = 0
    for (row, col), value in np.ndenumerate(cells):
        if value == 0:
            continue
        observed += 1
        place = _place(affine, row, col)
        if not (_is_inside(place, known) and known[place]):
            unseen[row, col] = value
            continue
        covered += 1
        is_wall, is_free = value > 128, value < 128
        if is_wall and total[place] <= free_below:
            faded[row, col] = 0
        if is_free and total[place] >= wall_above:
            faded[row, col] = 0
    return faded, unseen, observed, covered


def naive_copy(affine, source, cells):
    """Return the cells with what they lacked."""
    filled = cells.copy()
    for (row, col), value in np.ndenumerate(cells):
        place = _place(affine, row, col)
        if value == 0 and _is_inside(place, source) and source[place] != 0:
            filled[row, col] = source[place]
    return filled


def naive_clear(affine, shape, cells):
    """Return the cells without those inside another grid."""
    left, other = cells.copy(), np.zeros(shape)
    for row, col in np.ndindex(cells.shape):
        if _is_inside(_place(affine, row, col), other):
            left[row, col] = 0
    return left
