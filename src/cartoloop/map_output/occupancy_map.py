# SPDX-License-Identifier: Apache-2.0
"""All submaps at their optimised poses, composed into one occupancy map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import SubmapConfig
from cartoloop.errors import OutputError
from cartoloop.map_output.evidence_sum import EvidenceSum, cells_covering
from cartoloop.sensor.pose import Pose

if TYPE_CHECKING:
    from cartoloop.submaps.finished_grid import FinishedGrid


UNKNOWN = np.float32(-1.0)
"""Stands for the probability of cells that no submap has seen."""

MAX_LOG_ODDS = 4.6
"""Log-odds of the map are clamped to this and its negative, 99% and 1%: more certain is no
building, and exp() does not overflow."""

_MAX_CELLS = 2**29
"""Largest map [cells]: 2.5 GB while composing; buildings need a hundredth of it."""

_MARGIN_CELLS = 5
"""Unknown cells around the known part of the map, so that walls do not touch its edge."""


@dataclass(frozen=True, slots=True)
class MapFrame:
    """Where the cells of a map lie: how many rows, and the rest as in `OccupancyMap`."""

    num_rows: int
    origin_x: float
    origin_y: float
    resolution: float

    def to_pixels(self, points_map: FloatArray) -> FloatArray:
        """Return points (n, 2) [m, map frame] as image (column, row), 0 at the top left corner."""
        column = (points_map[:, 0] - self.origin_x) / self.resolution
        row = self.num_rows - (points_map[:, 1] - self.origin_y) / self.resolution
        return np.column_stack((column, row))


@dataclass(frozen=True)
class OccupancyMap:
    """The map as a grid.

    Attributes
    ----------
    probability : float32, shape (rows, cols), of occupancy, -1 where unknown; row = y, col = x.
    origin_x, origin_y : the lower-left corner of cell (0, 0) [m, map frame].
    resolution : cell edge [m].
    """

    probability: NDArray[np.float32]
    origin_x: float
    origin_y: float
    resolution: float

    @property
    def frame(self) -> MapFrame:
        """Where the cells lie, without them."""
        return MapFrame(len(self.probability), self.origin_x, self.origin_y, self.resolution)

    def to_pixels(self, points_map: FloatArray) -> FloatArray:
        """Return points (n, 2) [m, map frame] as image (column, row), 0 at the top left corner."""
        return self.frame.to_pixels(points_map)


class CellBox(NamedTuple):
    """Cells of a map by the lattice of its frame: cell (0, 0) begins at the origin.

    Attributes
    ----------
    first_col, first_row, end_col, end_row : the ends are exclusive.
    """

    first_col: int
    first_row: int
    end_col: int
    end_row: int


def compose_map(
    grids: Sequence[FinishedGrid],
    tf_map_submaps: FloatArray,
    config: SubmapConfig,
    box: CellBox | None = None,
) -> OccupancyMap:
    """Return the occupancy map of all submaps, judged by the sum of their evidence.

    Parameters
    ----------
    grids : the submaps' grids, m of them; nothing seen yields one unknown cell.
    tf_map_submaps : float64 (m, 3), their poses [m, m, rad].
    config : resolution of the map, and what a hit and a miss weigh. The grids may have another
        resolution: their evidence is interpolated.
    box : the cells to compose; None: all that submaps have seen, with a margin.

    Raises
    ------
    OutputError
        The submaps lie so far apart that the map would not fit in memory.

    Notes
    -----
    Log-odds add up (eq. 2 and 3, over submaps instead of scans), so that a wall that is hit in one
    submap and missed in another is judged by what each is worth, not by which was drawn last.
    Saturated cells have lost the count of their hits and misses, so hits keep the weight against
    misses that one has against the other in eq. (3).
    """
    seen = [
        (grid, Pose(*tf_map_submap))
        for grid, tf_map_submap in zip(grids, tf_map_submaps.tolist(), strict=True)
        if grid.size
    ]
    resolution = config.resolution
    if not seen:
        return OccupancyMap(np.full((1, 1), UNKNOWN), 0.0, 0.0, resolution)
    if box is None:
        lower, (num_rows, num_cols) = cells_covering(seen, resolution, _MARGIN_CELLS)
    else:
        lower = np.array((box.first_col, box.first_row))
        num_cols, num_rows = box.end_col - box.first_col, box.end_row - box.first_row
    if num_cols * num_rows > _MAX_CELLS:
        raise OutputError(
            f"the map would be {num_cols * resolution:.0f} m by {num_rows * resolution:.0f} m, "
            "more than fits in memory; the trajectory has probably come apart, or "
            f"cells of {resolution:g} m (local_slam.submaps.resolution) are too small"
        )
    evidence = EvidenceSum(lower, (num_rows, num_cols), config)
    for grid, pose in seen:
        evidence.add(grid, pose)
    total, known = evidence.total, evidence.known
    if box is not None:
        whole = (slice(0, num_rows), slice(0, num_cols))
        return _as_probabilities(total, known, whole, lower, resolution)
    return _cropped(total, known, lower, resolution)


def _cropped(
    total: NDArray[np.float32],
    known: BoolArray,
    lower: IntArray,
    resolution: float,
) -> OccupancyMap:
    """Return the known part of the map with a margin, as probabilities; overwrites `total`."""
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if len(rows) == 0:
        return OccupancyMap(np.full((1, 1), UNKNOWN), 0.0, 0.0, resolution)
    first_row, first_col = int(rows[0]) - _MARGIN_CELLS, int(cols[0]) - _MARGIN_CELLS
    part = (
        slice(first_row, int(rows[-1]) + _MARGIN_CELLS + 1),
        slice(first_col, int(cols[-1]) + _MARGIN_CELLS + 1),
    )
    return _as_probabilities(total, known, part, lower, resolution)


def _as_probabilities(
    total: NDArray[np.float32],
    known: BoolArray,
    part: tuple[slice, slice],
    lower: IntArray,
    resolution: float,
) -> OccupancyMap:
    """Return a part of the map, given the log-odds of its cells; overwrites `total`."""
    # 1 / (1 + exp(-total)), in place because there may be hundreds of millions of cells
    probability = total[part]
    np.clip(probability, -MAX_LOG_ODDS, MAX_LOG_ODDS, out=probability)
    np.exp(np.negative(probability, out=probability), out=probability)
    np.reciprocal(np.add(probability, 1.0, out=probability), out=probability)
    probability[~known[part]] = UNKNOWN
    return OccupancyMap(
        probability=probability,
        origin_x=float(lower[0] + part[1].start) * resolution,
        origin_y=float(lower[1] + part[0].start) * resolution,
        resolution=resolution,
    )
