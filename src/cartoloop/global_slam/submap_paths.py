# SPDX-License-Identifier: Apache-2.0
"""Path lengths and drift between submaps, along the robot's path and across loop closures."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import ConstraintSearchConfig
from cartoloop.kernels.shortest_paths import drift_along_paths, shortest_paths

_NOTHING: FloatArray = np.empty(0)

UNCONNECTED_M = 1e9
"""Path length from one session to the next [m]: the robot's path does not connect them."""

LOST_M = 40_000.0
"""The same across a gap in which the robot was lost [m]: so long that the drift allows any heading,
and any place within some tens of metres."""

FAR_M = 0.5 * UNCONNECTED_M
"""Longer paths lead from one session to another [m]."""

_SHORTEST_STEP_M = 1e-3
"""Path length between two submaps, at least: path lengths must be positive [m]."""


class SubmapPaths:
    """The shortest paths between submaps, along the robot's path and across loop closures.

    Parameters
    ----------
    config : gives the path length of a closure, and the drift along a path.
    submap_travelled : shape (m,), path length of the robot when each submap was begun [m].
    closures : int64, shape (k, 2): submap, and the submap that the node was inserted into.
    inside : shape (k,), path length from the beginning of that one to the node [m].
    """

    def __init__(
        self,
        config: ConstraintSearchConfig,
        submap_travelled: FloatArray = _NOTHING,
        closures: IntArray | None = None,
        inside: FloatArray | None = None,
    ) -> None:
        self._config = config
        self._num_submaps = m = len(submap_travelled)
        self._paths: dict[int, tuple[FloatArray, IntArray]] = {}
        self._last_drift: tuple[int, FloatArray, FloatArray] = (-1, _NOTHING, _NOTHING)
        if closures is None or inside is None or m == 0:
            return
        first, second = closures.min(axis=1), closures.max(axis=1)
        is_apart = submap_travelled[second] - submap_travelled[first] > 0.5 * LOST_M
        skips = np.flatnonzero((second - first > 1) | is_apart)
        numbers = (first * m + second)[skips]
        # Of each pair of submaps the closure with the shortest path.
        shortest = np.lexsort((inside[skips], numbers))
        pairs, chosen = np.unique(numbers[shortest], return_index=True)
        closure_lengths = config.closure_path_length + inside[skips][shortest][chosen]
        chain = np.arange(m - 1) * (m + 1) + 1
        lengths = np.concatenate(
            (
                np.maximum(np.diff(submap_travelled), _SHORTEST_STEP_M),
                closure_lengths,
            )
        )
        one, other = np.divmod(np.concatenate((chain, pairs)), m)
        ends = np.concatenate((one, other))
        order = np.argsort(ends, kind="stable")
        self._firsts = np.searchsorted(ends[order], np.arange(m + 1))
        self._neighbours = np.concatenate((other, one))[order]
        self._edge_lengths = np.tile(lengths, 2)[order]

    def __len__(self) -> int:
        return self._num_submaps

    def lengths_from(self, submap: int) -> FloatArray:
        """Return the lengths [m] of the shortest known paths from a submap, shape (m,).

        Empty where the submap is not known yet.
        """
        return self._paths_from(submap)[0] if submap < self._num_submaps else _NOTHING

    def drift_from(self, submap: int, positions: FloatArray) -> FloatArray:
        """Return the covariance of each submap's pose as one submap knows it, shape (m, 3, 3).

        Parameters
        ----------
        submap : one of the submaps that are known.
        positions : of the known submaps, map frame, shape (m, 2) [m].

        Returns
        -------
        covariances of x, y, theta along the shortest paths [m^2, m rad, rad^2], map axes.
        """
        # Scans that follow each other often have the same anchor.
        of, at, drift = self._last_drift
        if of == submap and np.array_equal(at, positions):
            return drift
        search = self._config.wide_search
        lengths, previous = self._paths_from(submap)
        upper = np.empty((self._num_submaps, 6))
        drift_along_paths(
            np.argsort(lengths, kind="stable"),
            lengths,
            previous,
            np.ascontiguousarray(positions),
            math.radians(search.rotation_drift_deg) ** 2,
            search.translation_drift**2,
            upper,
        )
        drift = upper[:, _SYMMETRIC]
        self._last_drift = submap, positions.copy(), drift
        return drift

    def _paths_from(self, submap: int) -> tuple[FloatArray, IntArray]:
        if submap not in self._paths:
            lengths = np.empty(self._num_submaps)
            previous = np.empty(self._num_submaps, dtype=np.int64)
            shortest_paths(
                self._firsts, self._neighbours, self._edge_lengths, submap, lengths, previous
            )
            self._paths[submap] = lengths, previous
        return self._paths[submap]


_SYMMETRIC = np.array(((0, 1, 2), (1, 3, 4), (2, 4, 5)))
