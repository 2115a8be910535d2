# SPDX-License-Identifier: Apache-2.0
"""Areas of a map that have appeared or disappeared, made of cells that differ."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.kernels.map_changes import LookGrids
from cartoloop.localisation.known_map import KnownMap
from cartoloop.quality.pairs import FLOOR, WALL
from cartoloop.sensor.pose import transform_points
from cartoloop.submaps.finished_grid import mean_value

MIN_BALANCE = 4
"""Scans that show the change of a cell less those that deny it, at least."""

MIN_SPAN_S = 1.0
"""Time from the first scan that shows the change of a cell to the last, at least [s]: people walk
through a cell in less."""

MIN_SHARE = 0.5
"""Share of the scans that show the change of a cell, of those that say something about it."""

BRIDGED_M = 0.15
"""Cells closer than this belong to one area [m]."""

MIN_SIZE_M2 = 0.03
"""Smaller areas are left out [m^2]: a chair seen from one side is larger."""


class Kind(StrEnum):
    """How an area differs: occupied now, or free now."""

    APPEARED = "appeared"
    DISAPPEARED = "disappeared"


@dataclass(frozen=True)
class ChangedArea:
    """An area that differs from the map.

    Attributes
    ----------
    kind : what happened to it.
    x, y : centre of its cells [m, map frame].
    size : of all its cells [m^2]. A scanner sees outlines: that is less than what they enclose.
    box : x_min, y_min, x_max, y_max [m, map frame].
    num_scans : number of compared scans that showed it, in the cell with the most.
    first_stamp, last_stamp : of the first and the last scan that showed it [s].
    confidence : from 0 to 1: share of the scans that showed it, of those that say something about
        it, with one scan for it and one against it added; mean of the cells.
    """

    kind: Kind
    x: float
    y: float
    size: float
    box: tuple[float, float, float, float]
    num_scans: int
    first_stamp: float
    last_stamp: float
    confidence: float


@dataclass(frozen=True, eq=False)
class Changes:
    """What differs between a map and what a robot saw.

    Attributes
    ----------
    known : the map.
    areas : the largest first.
    appeared, disappeared : cells of the areas, bool, of the shape of the map.
    num_scans : number of scans that were compared with the map.
    stamps : of the first and the last of them [s]; NaN without any.
    """

    known: KnownMap
    areas: tuple[ChangedArea, ...]
    appeared: BoolArray
    disappeared: BoolArray
    num_scans: int
    stamps: tuple[float, float]

    def of(self, kind: Kind) -> list[ChangedArea]:
        """Return the areas of a kind, the largest first."""
        return [area for area in self.areas if area.kind is kind]


def changes_of(
    known: KnownMap, looks: LookGrids, num_scans: int, stamps: tuple[float, float]
) -> Changes:
    """Return the areas of cells that differ.

    Parameters
    ----------
    known : the map.
    looks : what the scans came to.
    num_scans, stamps : see `Changes`.
    """
    cells = known.cell_grid.cells
    is_wall = cells >= mean_value(WALL)
    is_floor = (cells > 0) & (cells <= mean_value(FLOOR))
    differs = _differs(looks)
    areas: list[ChangedArea] = []
    shown = {
        Kind.APPEARED: differs & is_floor & (looks.ends > 0),
        Kind.DISAPPEARED: differs & is_wall,
    }
    kept = {kind: _kept_areas(known, looks, kind, each, areas) for kind, each in shown.items()}
    areas.sort(key=lambda area: (-area.size, area.kind, area.x, area.y))
    return Changes(
        known, tuple(areas), kept[Kind.APPEARED], kept[Kind.DISAPPEARED], num_scans, stamps
    )


def _differs(looks: LookGrids) -> BoolArray:
    """Return which cells differ from the map by what all scans showed of them."""
    shown, denied = looks.shown.astype(np.int64), looks.denied.astype(np.int64)
    differs: BoolArray = (
        (looks.balance >= MIN_BALANCE)
        & (looks.last - looks.first >= MIN_SPAN_S)
        & (shown >= MIN_SHARE * (shown + denied))
    )
    return differs


def _kept_areas(
    known: KnownMap, looks: LookGrids, kind: Kind, differs: BoolArray, out_areas: list[ChangedArea]
) -> BoolArray:
    """Add the areas of cells that are large enough; return their cells."""
    from scipy import ndimage  # slow to import

    resolution = known.cell_grid.resolution
    reach = max(round(0.5 * BRIDGED_M / resolution), 1)
    across = np.arange(-reach, reach + 1)
    disc = across[:, np.newaxis] ** 2 + across**2 <= reach**2
    labels, _ = ndimage.label(ndimage.binary_dilation(differs, disc), np.ones((3, 3)))
    labels[~differs] = 0
    kept = np.zeros(differs.shape, dtype=np.bool_)
    for number, box in enumerate(ndimage.find_objects(labels), 1):
        if box is None:
            continue
        rows, cols = np.nonzero(labels[box] == number)
        rows, cols = rows + box[0].start, cols + box[1].start
        if len(rows) * resolution**2 < MIN_SIZE_M2:
            continue
        kept[rows, cols] = True
        out_areas.append(_area(known, looks, kind, np.column_stack((rows, cols))))
    return kept


def _area(
    known: KnownMap,
    looks: LookGrids,
    kind: Kind,
    cells: np.ndarray[tuple[int, int], np.dtype[np.int64]],
) -> ChangedArea:
    grid = known.cell_grid
    at = tuple(cells.T)
    centres = _in_map(known, cells)
    x, y = centres.mean(axis=0).tolist()
    half = 0.5 * grid.resolution
    x_min, y_min = (centres.min(axis=0) - half).tolist()
    x_max, y_max = (centres.max(axis=0) + half).tolist()
    shown, denied = looks.shown[at].astype(np.float64), looks.denied[at].astype(np.float64)
    return ChangedArea(
        kind,
        x,
        y,
        len(cells) * grid.resolution**2,
        (x_min, y_min, x_max, y_max),
        int(shown.max()),
        float(looks.first[at].min()),
        float(looks.last[at].max()),
        float(((shown + 1.0) / (shown + denied + 2.0)).mean()),
    )


def _in_map(known: KnownMap, cells: np.ndarray[tuple[int, int], np.dtype[np.int64]]) -> FloatArray:
    """Return the centres of cells, given by row and column, in the map frame [m]."""
    grid = known.cell_grid
    origin = np.array((grid.origin_x, grid.origin_y))
    in_grid = cells[:, ::-1] * grid.resolution + origin
    return transform_points(known.tf_map_grid, in_grid)
