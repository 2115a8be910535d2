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


def _around(middle, reach):
    return tuple(slice(max(number - reach, 0), max(number + reach + 1, 0)) for number in middle)


def _has_floor_beside(is_wall, affine, total, place, reach, behind):
    """Whether there is floor on both sides of the line through the walls around a place."""
    rows, cols = np.nonzero(is_wall)
    near = np.maximum(np.abs(rows - place[0]), np.abs(cols - place[1])) <= 2 * reach
    y, x = rows[near] - place[0], cols[near] - place[1]
    count = len(x)
    difference = float(count * ((x * x).sum() - (y * y).sum()) - (x.sum() ** 2 - y.sum() ** 2))
    twice = float(2 * (count * (x * y).sum() - x.sum() * y.sum()))
    length = math.sqrt(difference * difference + twice * twice)
    cos_twice = difference / length if length else 1.0
    cos, sin = math.sqrt(0.5 * (1.0 + cos_twice)), math.sqrt(0.5 * (1.0 - cos_twice))
    sin = math.copysign(sin, -1.0 if twice < 0.0 else 1.0)
    sides = [
        _place(affine, place[0] + side * cos, place[1] - side * sin) for side in (-behind, behind)
    ]
    return all((total[_around(side, reach)] < 0.0).any() for side in sides)


def naive_review(cells, affine, total, few_below, reach, behind, faded, left):
    """Return the cells that stay and those whose evidence is needed, reviewed.

    `behind` is how far there must be floor for walls that stayed, and for those that faded.
    """
    is_wall, faded, left = cells > 128, faded.copy(), left.copy()
    was_faded = faded == 0
    evidence = np.zeros(cells.shape)
    for place in np.argwhere(is_wall):
        if _is_inside(on_map := _place(affine, *place), total):
            evidence[tuple(place)] = total[on_map]
    for place in map(tuple, np.argwhere(is_wall)):
        on_map = _place(affine, *place)
        if not _is_inside(on_map, total) or total[on_map] >= 0.0:
            continue
        if (total[_around(on_map, reach)] > 0.0).any():
            continue
        is_passed, is_surely_passed = (
            _has_floor_beside(is_wall, affine, total, place, reach, each) for each in behind
        )
        if was_faded[place] and not is_surely_passed:
            faded[place] = left[place] = cells[place]
        is_few = evidence[_around(place, reach)].sum() <= few_below
        if not was_faded[place] and is_passed and is_few:
            faded[place] = left[place] = 0
    return faded, left


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
