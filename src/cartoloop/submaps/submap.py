# SPDX-License-Identifier: Apache-2.0
"""Submaps: small chunks of the world, each built of a few consecutive scans (section IV-B)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cartoloop.config import SubmapConfig
from cartoloop.sensor.pose import FloatArray, Pose
from cartoloop.submaps.probability_grid import ProbabilityGrid
from cartoloop.submaps.range_data_inserter import insert_cells, scan_cells


@dataclass(slots=True)
class Submap:
    """A probability grid and where it stands.

    Attributes
    ----------
    index : its number, in the order of creation.
    tf_local_submap : its pose; unrotated, on a grid point of the local frame, so that the lattices
        of all submaps coincide.
    grid : in the submap's frame.
    num_scans : how many scans have been inserted.
    travelled : how far the sensor has gone between the first and the last of them [m].
    """

    index: int
    tf_local_submap: Pose
    grid: ProbabilityGrid
    num_scans: int = 0
    travelled: float = 0.0


@dataclass(frozen=True, slots=True)
class Insertion:
    """What one scan did to the active submaps.

    Attributes
    ----------
    submaps : the submaps it was inserted into, the older first.
    finished : the submap that was completed by it, or None.
    """

    submaps: tuple[Submap, ...]
    finished: Submap | None


class ActiveSubmaps:
    """The two overlapping submaps that scans are inserted into; the older one is matched against.

    A new submap starts every `num_range_data` scans, or every `max_travel` metres where scans are
    sparse; each lasts twice as long, so that the one that is matched against is always half full
    after the start.
    """

    def __init__(self, config: SubmapConfig) -> None:
        self._config = config
        self._submaps: list[Submap] = []
        self._num_created = 0
        self._last_position: tuple[float, float] | None = None

    @property
    def matching(self) -> Submap | None:
        """The submap to match against, or None before the first scan."""
        return self._submaps[0] if self._submaps else None

    @property
    def submaps(self) -> tuple[Submap, ...]:
        """The active submaps, the older first."""
        return tuple(self._submaps)

    def insert(
        self, tf_local_sensor: Pose, returns_local: FloatArray, misses_local: FloatArray
    ) -> Insertion:
        """Insert a scan into the active submaps, starting and finishing submaps as they fill.

        Parameters
        ----------
        tf_local_sensor : where the rays start.
        returns_local, misses_local : float64, shapes (n, 2), (k, 2), ends of rays that did and did
            not hit something [m, local frame].
        """
        config = self._config
        if not self._submaps or self._is_half_full(self._submaps[-1]):
            self._start_submap(tf_local_sensor)
        cells = scan_cells(tf_local_sensor, returns_local, misses_local, config.resolution)
        step = 0.0
        if self._last_position is not None:
            x, y = self._last_position
            step = math.hypot(tf_local_sensor.x - x, tf_local_sensor.y - y)
        self._last_position = (tf_local_sensor.x, tf_local_sensor.y)
        for submap in self._submaps:
            submap.travelled += step if submap.num_scans else 0.0
            insert_cells(submap.grid, cells, config, self._lattice_origin(submap))
            submap.num_scans += 1
        inserted = tuple(self._submaps)
        finished = None
        if len(self._submaps) == 2 and self._is_half_full(self._submaps[1]):
            finished = self._submaps.pop(0)
        return Insertion(inserted, finished)

    def _is_half_full(self, submap: Submap) -> bool:
        """Return whether it is time for the next submap to start."""
        config = self._config
        return submap.num_scans >= config.num_range_data or submap.travelled >= config.max_travel

    def _start_submap(self, tf_local_sensor: Pose) -> None:
        r = self._config.resolution
        origin = Pose(
            math.floor(tf_local_sensor.x / r + 0.5) * r,
            math.floor(tf_local_sensor.y / r + 0.5) * r,
            0.0,
        )
        self._submaps.append(Submap(self._num_created, origin, ProbabilityGrid(r)))
        self._num_created += 1

    def _lattice_origin(self, submap: Submap) -> tuple[int, int]:
        """Return the submap's origin as lattice coordinates of the local frame."""
        r = self._config.resolution
        return round(submap.tf_local_submap.x / r), round(submap.tf_local_submap.y / r)
