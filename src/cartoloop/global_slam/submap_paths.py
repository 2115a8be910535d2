# SPDX-License-Identifier: Apache-2.0
"""Path lengths between submaps, along the robot's path and across loop closures."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import ConstraintSearchConfig
from cartoloop.kernels.shortest_paths import shortest_paths

_NOTHING: FloatArray = np.empty(0)

_SHORTEST_STEP_M = 1e-3
"""Path length between two submaps, at least: path lengths must be positive [m]."""

LEAST_DRIFT = 1e-6
"""Drift per metre, at least, where a path length is divided by it."""


def longest_path(config: ConstraintSearchConfig) -> float:
    """Return a path length beyond which windows grow no more, with 1 m to spare [m]."""
    linear = config.linear_search_window - config.min_linear_search_window
    return linear / max(config.linear_drift, LEAST_DRIFT) + 1.0


class SubmapPaths:
    """The shortest paths between submaps, along the robot's path and across loop closures.

    Parameters
    ----------
    config : gives the path length of a closure, and the longest that matters.
    submap_travelled : shape (m,), path length of the robot when each submap was begun [m].
    closures : int64, shape (k, 2): submap, and the submap that the node was inserted into.
    """

    def __init__(
        self,
        config: ConstraintSearchConfig,
        submap_travelled: FloatArray = _NOTHING,
        closures: IntArray | None = None,
    ) -> None:
        self._num_submaps = m = len(submap_travelled)
        self._longest = longest_path(config)
        self._lengths: dict[int, FloatArray] = {}
        if closures is None or m == 0:
            return
        first, second = closures.min(axis=1), closures.max(axis=1)
        pairs = np.unique((first * m + second)[second - first > 1])
        chain = np.arange(m - 1) * (m + 1) + 1
        lengths = np.concatenate(
            (
                np.maximum(np.diff(submap_travelled), _SHORTEST_STEP_M),
                np.full(len(pairs), config.closure_path_length),
            )
        )
        one, other = np.divmod(np.concatenate((chain, pairs)), m)
        ends = np.concatenate((one, other))
        order = np.argsort(ends, kind="stable")
        self._firsts = np.searchsorted(ends[order], np.arange(m + 1))
        self._neighbours = np.concatenate((other, one))[order]
        self._edge_lengths = np.tile(lengths, 2)[order]

    def lengths_from(self, submap: int) -> FloatArray:
        """Return the lengths [m] of the shortest known paths from a submap, shape (m,).

        Empty where the submap is not known yet; inf for paths too long to matter.
        """
        if submap >= self._num_submaps:
            return _NOTHING
        if submap not in self._lengths:
            lengths = self._lengths[submap] = np.empty(self._num_submaps)
            shortest_paths(
                self._firsts,
                self._neighbours,
                self._edge_lengths,
                submap,
                self._longest,
                lengths,
            )
        return self._lengths[submap]
