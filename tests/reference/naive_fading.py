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


def naive_fade(cells, affine, total, known, limits, sure):
    """Return the cells that stay, those whose evidence is needed, and both counts.

    `limits` are log-odds up to which cells are free, from which walls; with `sure` surely.
    """
    faded, left = cells.copy(), np.zeros_like(cells)
    observed = covered = 0
    is_sure = (total <= sure[0]) | (total >= sure[1])
    for (row, col), value in np.ndenumerate(cells):
        if value == 0:
            continue
        observed += 1
        left[row, col] = value
        place = _place(affine, row, col)
        if not (_is_inside(place, known) and known[place]):
            continue
        covered += 1
        is_wall, is_free = value > 128, value < 128
        is_faded = (is_wall and total[place] <= limits[0]) or (
            is_free and total[place] >= limits[1]
        )
        around = tuple(slice(max(number - 1, 0), number + 2) for number in place)
        if is_faded:
            faded[row, col] = 0
        if is_faded or is_sure[around].any():
            left[row, col] = 0
    return faded, left, observed, covered


def naive_seen_through(cells, affine, total, free_below, reach, faded):
    """Return which cells fade because a few beams have seen through them."""
    is_wall, through = cells > 128, np.zeros(cells.shape, dtype=bool)
    evidence = np.zeros(cells.shape)
    for place in np.argwhere(is_wall):
        if _is_inside(on_map := _place(affine, *place), total):
            evidence[tuple(place)] = total[on_map]
    for row, col in np.argwhere(is_wall & (faded > 128)):
        place = _place(affine, row, col)
        if not _is_inside(place, total) or total[place] >= 0.0:
            continue
        around, on_map = (
            tuple(slice(max(number - reach, 0), number + reach + 1) for number in middle)
            for middle in ((row, col), place)
        )
        through[row, col] = not (total[on_map] > 0.0).any() and evidence[around].sum() <= free_below
    return through


def naive_hand_over(affine, source, sums, cells):
    """Return the cells with the evidence of others, and what was added."""
    filled, taken = cells.copy(), np.zeros_like(cells)
    for (row, col), value in np.ndenumerate(cells):
        place = _place(affine, row, col)
        if _is_inside(place, source) and source[place] != 0:
            filled[row, col] = sums[value, source[place]]
            taken[row, col] = source[place]
    return filled, taken


def naive_clear(affine, shape, cells):
    """Return the cells without those inside another grid."""
    left, other = cells.copy(), np.zeros(shape)
    for row, col in np.ndindex(cells.shape):
        if _is_inside(_place(affine, row, col), other):
            left[row, col] = 0
    return left
