# SPDX-License-Identifier: Apache-2.0
"""What bounds a point in a box of translations, pixel by pixel."""

from __future__ import annotations


def naive_maximum(cells, first_col, first_row, end_col, end_row):
    """Return the largest of the cells in a rectangle; outside the grid all is zero."""
    inside = cells[max(first_row, 0) : max(end_row, 0), max(first_col, 0) : max(end_col, 0)]
    return int(inside.max()) if inside.size else 0


def naive_box(cells, col, row, height):
    """Eq. (17): the maximum of the 2^h x 2^h box that begins at a pixel."""
    return naive_maximum(cells, col, row, col + 2**height, row + 2**height)


def naive_halved(cells, col, row, height):
    """The maximum of all cells of 2^h x 2^h pixels that the box meets."""
    edge = 2**height
    return naive_maximum(
        cells,
        col // edge * edge,
        row // edge * edge,
        ((col + edge - 1) // edge + 1) * edge,
        ((row + edge - 1) // edge + 1) * edge,
    )


def naive_joined(cells, col, row, height):
    """The maximum of the cell of 2^h x 2^h pixels that the box begins in, and of the next ones."""
    edge = 2**height
    reach = edge if height == 0 else 2 * edge
    first_col, first_row = col // edge * edge, row // edge * edge
    return naive_maximum(cells, first_col, first_row, first_col + reach, first_row + reach)


def naive_bound(value_of, cells, cols, rows, col, row, height):
    """Return the upper bound of eq. (16): the sum over the points, moved by (col, row)."""
    return sum(
        value_of(cells, x + col, y + row, height)
        for x, y in zip(cols.tolist(), rows.tolist(), strict=True)
    )
