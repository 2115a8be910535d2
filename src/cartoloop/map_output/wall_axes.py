# SPDX-License-Identifier: Apache-2.0
"""What is a wall in a map, and the axes of one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray, IntArray

WALL, MAYBE_WALL, FLOOR = 0.7, 0.5, 0.3
"""Least probability of a wall, of a cell that may be one, and largest of floor."""

_SIDE_CELLS = 4.0
"""At this distance, less is known behind a wall than before it [cells]."""


def axes_of(places: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the middle of a wall, shape (2,), and its axes, shape (2, 2).

    Parameters
    ----------
    places : int64, shape (n, 2), rows and columns of its cells; n > 0.

    Returns
    -------
    The columns of the axes are the directions across and along the wall, as rows and columns.
    """
    middle: FloatArray = places.mean(axis=0)
    _, axes = np.linalg.eigh((places - middle).T @ (places - middle))
    return middle, axes


def directions_behind(walls: NDArray[np.float32], places: IntArray) -> list[FloatArray]:
    """Return the direction across a wall, as rows and columns, to the side where less is known.

    Where both sides are known equally well, both directions.

    Parameters
    ----------
    walls : probabilities of the map with the wall; negative where it is not known.
    places : int64, shape (n, 2), rows and columns of cells of the wall.
    """
    across: FloatArray = axes_of(places)[1][:, 0]
    before, after = (
        np.count_nonzero(cells_at(walls, places + side * _SIDE_CELLS * across) < 0.0)
        for side in (-1.0, 1.0)
    )
    if before == after:
        return [across, -across]
    return [across if after > before else -across]


def cells_at(walls: NDArray[np.float32], places: FloatArray) -> NDArray[np.float32]:
    """Return the probabilities at rows and columns, -1 outside the map."""
    cells = np.rint(places).astype(np.int64)
    inside = ((cells >= 0) & (cells < np.array(walls.shape))).all(axis=1)
    found = np.full(len(cells), -1.0, dtype=np.float32)
    found[inside] = walls[tuple(cells[inside].T)]
    return found
