# SPDX-License-Identifier: Apache-2.0
"""The map that a robot is localised in: one grid, prepared for searching and for tracking."""

from __future__ import annotations

import math
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import ByteArray, FloatArray
from cartoloop.errors import InputError
from cartoloop.evaluation.map_image import MapImage, read_map
from cartoloop.kernels.map_agreement import CellGrid
from cartoloop.localisation.fit import Fit, FitJudge
from cartoloop.localisation.own_scans import learn_from_own_scans
from cartoloop.map_data import MapData
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.map_output.main_part import main_submaps
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.quality.pairs import WALL
from cartoloop.result import load_map
from cartoloop.scan_matching.branch_and_bound import SubmapMatcher
from cartoloop.scan_matching.least_squares import SmoothMap
from cartoloop.scan_matching.precomputation_grid import MAP_STRIDES
from cartoloop.sensor.pose import IDENTITY, Pose, compose, inverse
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import (
    MAX_PROBABILITY,
    MIN_PROBABILITY,
    FinishedGrid,
    mean_value,
    quantize_probabilities,
)

MIN_RESOLUTION_M, WORKING_RESOLUTION_M = 0.035, 0.05
"""Images with smaller pixels are searched at about the second [m]: smaller pixels are not more
accurate, and cost more."""

MAX_CELLS = 2**26
"""Largest map [cells]: a square of 400 m; it takes 1.2 GB."""

FOREIGN_SCORE = 0.65
"""Score that scans usually reach in a map without scans of its own, see :class:`Fit`."""

FOREIGN_AGREEMENT, FOREIGN_LOW_AGREEMENT = 0.9, 0.8
"""Agreement that they usually reach, and that nine of ten reach."""

FOREIGN_DISTINCTNESS, FOREIGN_LOW_DISTINCTNESS = 0.88, 0.78
"""The same of their distinctness."""

TILE_M = 8.0
"""Edge of the parts of the map that are searched for their best places [m]."""

_UNKNOWN_SHADE, _SHADE_TOLERANCE = 1.0 - 205.0 / 255.0, 0.002
"""Occupancy of the shade of unknown pixels, which some programs write with thresholds that would
make it floor."""


class KnownMap:
    """A finished map, as one grid.

    Parameters
    ----------
    cells : uint8, shape (rows, cols): 0 where unknown, as those of a `FinishedGrid`.
    origin_x, origin_y : centre of cell (0, 0) [m, grid frame].
    resolution : edge of a cell [m].
    tf_map_grid : pose of the grid in the map frame.
    name : of the map, for messages.

    Attributes
    ----------
    matcher : branch and bound in the grid; its precomputed grids are made here, and kept.
    smooth_map : for least squares.
    judge : of how well scans fit.
    tile_centres : float64, shape (n, 3), poses in the middle of the squares of `TILE_M` in which
        anything is known, grid frame.
    usual : the fit that scans usually reach.
    low_score, low_agreement, low_distinctness : those that nine of ten scans reach; the score is 0
        where it is not known.
    has_own_fits : whether these are of the map's own scans; otherwise they are assumed.

    Raises
    ------
    InputError
        Nothing of the map is known, or it is too large.
    """

    def __init__(
        self,
        cells: ByteArray,
        origin_x: float,
        origin_y: float,
        resolution: float,
        tf_map_grid: Pose,
        name: str,
    ) -> None:
        self._raise_if_unusable(cells, name)
        self.name = name
        self.tf_map_grid = tf_map_grid
        self._tf_grid_map = inverse(tf_map_grid)
        self.grid = FinishedGrid(cells, origin_x, origin_y, resolution)
        self._cells = CellGrid(np.ascontiguousarray(cells), origin_x, origin_y, resolution)
        self.judge = FitJudge(self._cells)
        # A copy: the memory that the probabilities come in is used again.
        self.smooth_map = SmoothMap(
            self.grid.probabilities().copy(), origin_x, origin_y, resolution
        )
        self.matcher = SubmapMatcher(self.grid, MAP_STRIDES)
        self.matcher.match(
            np.zeros((1, 2)), IDENTITY, linear_window=0.0, angular_window=0.0, min_score=0.0
        )
        self.tile_centres = self._tile_centres()
        self.usual = Fit(FOREIGN_SCORE, FOREIGN_AGREEMENT, FOREIGN_DISTINCTNESS, 0)
        self.has_own_fits = False
        self.low_score = 0.0
        self.low_agreement = FOREIGN_LOW_AGREEMENT
        self.low_distinctness = FOREIGN_LOW_DISTINCTNESS

    @staticmethod
    def _raise_if_unusable(cells: ByteArray, name: str) -> None:
        if not np.any(cells >= mean_value(WALL)):
            raise InputError(f"{name}: the map has no walls, so that no scan can be found in it")
        if cells.size > MAX_CELLS:
            raise InputError(
                f"{name}: the map has {cells.shape[1]} by {cells.shape[0]} cells, more than can be "
                "searched; crop it, or give larger cells"
            )

    def _tile_centres(self) -> FloatArray:
        grid = self._cells
        edge = max(round(TILE_M / grid.resolution), 1)
        rows, cols = grid.cells.shape
        middles = [
            (row + 0.5 * edge, col + 0.5 * edge)
            for row in range(0, rows, edge)
            for col in range(0, cols, edge)
            if grid.cells[row : row + edge, col : col + edge].any()
        ]
        at = np.array(middles) * grid.resolution + (grid.origin_y, grid.origin_x)
        return np.column_stack((at[:, 1], at[:, 0], np.zeros(len(at))))

    @property
    def cell_grid(self) -> CellGrid:
        """The cells, as kernels take them; read only."""
        return self._cells

    def to_grid(self, tf_map: Pose) -> Pose:
        """Return a pose in the map frame as one in the grid's."""
        return compose(self._tf_grid_map, tf_map)

    def to_map(self, tf_grid: Pose) -> Pose:
        """Return a pose in the grid's frame as one in the map frame."""
        return compose(self.tf_map_grid, tf_grid)

    def value_at(self, tf_map: Pose) -> int:
        """Return the value of the cell at a position, 0 where unknown."""
        at = self.to_grid(tf_map)
        grid = self._cells
        col = math.floor((at.x - grid.origin_x) / grid.resolution + 0.5)
        row = math.floor((at.y - grid.origin_y) / grid.resolution + 0.5)
        num_rows, num_cols = grid.cells.shape
        return int(grid.cells[row, col]) if 0 <= col < num_cols and 0 <= row < num_rows else 0

    def fit(self, points: FloatArray, beam_origin: Pose, tf_map_tracking: Pose) -> Fit:
        """Return how well a scan fits at a pose.

        Parameters
        ----------
        points : float64, shape (n, 2), tracking frame [m].
        beam_origin : pose of the scanner on the robot.
        """
        return self.fit_all(
            ScanPoints.of([points]),
            np.array((beam_origin[:2],)),
            np.array((tf_map_tracking,), dtype=np.float64),
        )

    def score(self, points: FloatArray, tf_map_tracking: Pose) -> float:
        """Return the score alone of :meth:`fit`: most of its time is spent along the beams."""
        pose = np.array((self.to_grid(tf_map_tracking),), dtype=np.float64)
        return self.judge.score(ScanPoints.of([points]), pose)

    def fit_all(self, scans: ScanPoints, beam_origins: FloatArray, poses: FloatArray) -> Fit:
        """Return how well scans fit together.

        Parameters
        ----------
        scans : k of them.
        beam_origins : float64, shape (k, 2), where their beams start, tracking frame [m].
        poses : float64, shape (k, 3), tf_map_tracking of each.
        """
        at = [self.to_grid(Pose(*pose)) for pose in poses.tolist()]
        return self.judge.fit(scans, beam_origins, np.array(at, dtype=np.float64).reshape(-1, 3))


def known_map_of(data: MapData, name: str = "the map") -> KnownMap:
    """Return a map of ours for localisation: its main part; its usual fit is that of its own scans.

    Raises
    ------
    InputError
        The map is empty, or too large.
    """
    composed = compose_map(*main_submaps(data), data.config.local_slam.submaps)
    resolution = composed.resolution
    known = KnownMap(
        _quantized(composed.probability),
        composed.origin_x + 0.5 * resolution,
        composed.origin_y + 0.5 * resolution,
        resolution,
        IDENTITY,
        name,
    )
    own = learn_from_own_scans(known.judge, data)
    if own is not None:
        known.usual, known.has_own_fits = own.usual, True
        known.low_score, known.low_agreement = own.low_score, own.low_agreement
        known.low_distinctness = own.low_distinctness
    return known


def known_map_of_image(image: MapImage, name: str = "the map") -> KnownMap:
    """Return a map for localisation, given an image and where it lies, of whatever program.

    Raises
    ------
    InputError
        Nothing of the map is known, or it is too large.
    """
    occupancy = image.occupancy
    cells = np.zeros(occupancy.shape, dtype=np.uint8)
    known = (occupancy >= 0.0) & (np.abs(occupancy - _UNKNOWN_SHADE) > _SHADE_TOLERANCE)
    cells[known & (occupancy < image.free_thresh)] = 1
    cells[known & (occupancy > image.occupied_thresh)] = 255
    resolution = image.resolution
    if resolution < MIN_RESOLUTION_M:
        cells, factor = _coarser(cells, round(WORKING_RESOLUTION_M / resolution))
        resolution *= factor
    half = 0.5 * resolution
    return KnownMap(cells, half, half, resolution, image.origin, name)


def load_known_map(path: str | PathLike[str]) -> KnownMap:
    """Return the map in a file for localisation.

    Parameters
    ----------
    path : a folder that ``cartoloop map`` wrote, the map file in it, or the YAML file of an image
        as ROS's map_server reads it, of whatever program.

    Raises
    ------
    InputError
        It is not there, is damaged, or holds nothing that a scan can be found in.
    """
    path = Path(path)
    is_image = path.suffix.lower() in (".yaml", ".yml") or (
        path.is_dir() and not (path / FILE_NAME).exists() and (path / "map.yaml").is_file()
    )
    if is_image:
        return known_map_of_image(read_map(path), str(path))
    return known_map_of(load_map(path), str(path))


def _quantized(probability: NDArray[np.float32]) -> ByteArray:
    """Return the values of cells with a probability, -1 where unknown."""
    clamped = np.clip(probability, MIN_PROBABILITY, MAX_PROBABILITY)
    clamped[probability < 0.0] = 0.0
    return quantize_probabilities(clamped)


def _coarser(cells: ByteArray, factor: int) -> tuple[ByteArray, int]:
    """Return the maxima of blocks of `factor` by `factor` cells, and the factor."""
    rows, cols = cells.shape
    padded = np.pad(cells, ((0, -rows % factor), (0, -cols % factor)))
    blocks = padded.reshape(padded.shape[0] // factor, factor, padded.shape[1] // factor, factor)
    return np.ascontiguousarray(blocks.max(axis=(1, 3))), factor
