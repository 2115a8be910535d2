# SPDX-License-Identifier: Apache-2.0
"""Submaps: small parts of the world, each built from consecutive scans (section IV-B)."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

from cartoloop.arrays import FloatArray
from cartoloop.config import SubmapConfig
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.range_noise import NO_NOISE, Noise
from cartoloop.submaps.probability_grid import (
    ProbabilityGrid,
    ScanCells,
    cells_with_walls,
    insert_cells,
)

SPARSE_STEP_M = 0.5
"""Steps from scan to scan from which scans are sparse [m]. A wall is seen a few times only, and
where matching is wrong by more than the noise: what one scan hides, another may rightly show."""

WEIGHT_STEP_M, MAX_WEIGHT = 0.25, 4.0
"""A sparse scan counts once for each such step since the last one [m], as often as dense scans were
inserted on that path, and not more often than the second. Seen free once only, cells would be worth
more in (CS) than those never seen, and would attract the next scans."""

UNCERTAIN_SIGMAS = 1.5
"""So close to its return, a ray of a noisy scanner does not show free space [standard deviations of
a range]: half of the rays end behind the wall, and would count its cells as free. Where scans are
sparse they do: few others would show what is free."""


@dataclass(slots=True)
class Submap:
    """A probability grid and its pose.

    Attributes
    ----------
    index : its number, in the order of creation.
    tf_local_submap : its pose; not rotated, on a grid point of the local frame, so that the
        lattices of all submaps coincide.
    grid : in the submap's frame.
    num_scans : number of scans inserted.
    travelled : path length of the sensor between the first and the last of them [m].
    """

    index: int
    tf_local_submap: Pose
    grid: ProbabilityGrid
    num_scans: int = 0
    travelled: float = 0.0

    @property
    def is_sparse(self) -> bool:
        """Whether its scans are far apart in the mean."""
        return self.travelled > SPARSE_STEP_M * max(self.num_scans - 1, 0)


@dataclass(frozen=True, slots=True)
class Insertion:
    """The result of inserting a scan into the active submaps.

    Attributes
    ----------
    submaps : the submaps it was inserted into, the older first.
    finished : the submap that it finished, or None.
    """

    submaps: tuple[Submap, ...]
    finished: Submap | None


class ActiveSubmaps:
    """The two overlapping submaps that scans are inserted into; the older one is matched against.

    A new submap starts every `num_range_data` scans, or every `max_travel` metres where scans are
    sparse; each lasts twice as long, so that the older one is always at least half full,
    except after the start, and after a stretch without a match: what was seen before and after it
    does not belong into one submap, which is rigid.

    Parameters
    ----------
    config : when they start and finish, and how cells change.
    first_index : index of the first submap.
    known : indices of submaps whose finished grids are known already, since an interrupted run is
        resumed: they are not filled again.
    """

    def __init__(
        self, config: SubmapConfig, first_index: int = 0, known: Collection[int] = ()
    ) -> None:
        self._config = config
        self._known = known
        self._submaps: list[Submap] = []
        self._left: list[Submap] = []  # that are finished with the next scans
        self._next_index = first_index
        self._last_position: tuple[float, float] | None = None

    @property
    def submaps(self) -> tuple[Submap, ...]:
        """The active submaps, the older first."""
        return tuple(self._submaps)

    @property
    def unfinished(self) -> tuple[Submap, ...]:
        """All submaps that no scan has finished yet, the oldest first."""
        return tuple(self._left + self._submaps)

    def insert(
        self,
        tf_local_sensor: Pose,
        returns_local: FloatArray,
        misses_local: FloatArray,
        *,
        tf_local_robot: Pose | None = None,
        noise: Noise = NO_NOISE,
        starts_over: bool = False,
    ) -> Insertion:
        """Insert a scan into the active submaps, starting and finishing submaps as they fill.

        Parameters
        ----------
        tf_local_sensor : start of the rays.
        returns_local, misses_local : float64, shapes (n, 2), (k, 2), ends of rays with and
            without a return [m, local frame].
        tf_local_robot : its steps count as travel: scanners in turn are in different places of the
            robot. By default the sensor's.
        noise : of the ranges, if they are noisy.
        starts_over : whether a new submap begins, and no more scans go into the others: the last of
            these is among the submaps of the insertion, but the scan is not drawn in it.
        """
        config = self._config
        before: list[Submap] = []
        if starts_over and self._submaps:
            before = self._submaps[-1:]
            self._left += self._submaps
            self._submaps = []
        if not self._submaps or self._is_half_full(self._submaps[-1]):
            self._start_submap(tf_local_sensor)
        cells: ScanCells | None = None
        step, robot = 0.0, tf_local_robot or tf_local_sensor
        if self._last_position is not None:
            x, y = self._last_position
            step = math.hypot(robot.x - x, robot.y - y)
        self._last_position = (robot.x, robot.y)
        is_dense = step < SPARSE_STEP_M
        weight = 1.0 if is_dense else min(step / WEIGHT_STEP_M, MAX_WEIGHT)
        for submap in self._submaps:
            submap.travelled += step if submap.num_scans else 0.0
            if submap.index not in self._known:
                if cells is None:
                    cells = self._cells(
                        tf_local_sensor,
                        returns_local,
                        misses_local,
                        noise,
                        is_dense=is_dense,
                    )
                insert_cells(submap.grid, cells, config, self._lattice_origin(submap), weight)
            submap.num_scans += 1
        inserted = tuple(before + self._submaps)
        if len(self._submaps) == 2 and self._is_half_full(self._submaps[1]):
            self._left.append(self._submaps.pop(0))
        return Insertion(inserted, self._left.pop(0) if self._left else None)

    def _cells(
        self,
        tf_local_sensor: Pose,
        returns_local: FloatArray,
        misses_local: FloatArray,
        noise: Noise,
        *,
        is_dense: bool,
    ) -> ScanCells:
        """Return the cells of a scan, those behind its walls among them where scans are dense."""
        uncertain = UNCERTAIN_SIGMAS * noise.constant, UNCERTAIN_SIGMAS * noise.share
        return cells_with_walls(
            tf_local_sensor,
            returns_local,
            misses_local,
            self._config,
            uncertain if is_dense else (0.0, 0.0),
            are_hidden=is_dense,
        )

    def _is_half_full(self, submap: Submap) -> bool:
        """Return whether the next submap is due to start."""
        config = self._config
        return submap.num_scans >= config.num_range_data or submap.travelled >= config.max_travel

    def _start_submap(self, tf_local_sensor: Pose) -> None:
        r = self._config.resolution
        origin = Pose(
            math.floor(tf_local_sensor.x / r + 0.5) * r,
            math.floor(tf_local_sensor.y / r + 0.5) * r,
            0.0,
        )
        self._submaps.append(Submap(self._next_index, origin, ProbabilityGrid(r)))
        self._next_index += 1

    def _lattice_origin(self, submap: Submap) -> tuple[int, int]:
        """Return the submap's origin as lattice coordinates of the local frame."""
        r = self._config.resolution
        return round(submap.tf_local_submap.x / r), round(submap.tf_local_submap.y / r)
