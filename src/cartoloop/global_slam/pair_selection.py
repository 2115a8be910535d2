# SPDX-License-Identifier: Apache-2.0
"""How well the graph knows pairs of node and finished submap, and how large a window that asks for.

The window need not be 7 m where the graph knows the relative pose to half a metre. What it knows
is told by the shortest way from the one to the other, along the robot's path and across the loop
closures found so far: dead reckoning errs in proportion to it. From a node it leads first to the
submap that it was inserted into, or along the path to the nearest node that closed a loop.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from cartoloop.config import ConstraintSearchConfig
from cartoloop.kernels.shortest_ways import shortest_ways

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NOTHING: FloatArray = np.empty(0)

CLOSURE_LENGTH_M = 0.5
"""A loop closure is as good as so much of dead reckoning."""


class PairSelection:
    """Knows how far apart submaps and nodes are along the ways that the graph knows."""

    def __init__(self, config: ConstraintSearchConfig) -> None:
        self._config = config
        self._num_submaps = 0
        self._firsts = np.zeros(1, dtype=np.int64)
        self._neighbours = np.empty(0, dtype=np.int64)
        self._edge_lengths = np.empty(0, dtype=np.float64)
        self._lengths: dict[int, FloatArray] = {}
        self._num_found: Counter[tuple[int, int]] = Counter()
        self._num_sought_bound: Counter[tuple[int, int]] = Counter()

    def update(self, submap_travelled: FloatArray, closures: IntArray) -> None:
        """Learn of the closures found so far.

        Parameters
        ----------
        submap_travelled : shape (m,), how far the robot had come when each submap was begun [m].
        closures : int64, shape (k, 2): submap, and the submap that the node was inserted into.
        """
        m = len(submap_travelled)
        first, second = closures.min(axis=1), closures.max(axis=1)
        pairs = np.unique((first * m + second)[second - first > 1])
        chain = np.arange(m - 1) * (m + 1) + 1
        lengths = np.concatenate(
            (
                np.maximum(np.diff(submap_travelled), 1e-3),
                np.full(len(pairs), CLOSURE_LENGTH_M),
            )
        )
        one, other = np.divmod(np.concatenate((chain, pairs)), m)
        ends = np.concatenate((one, other))
        order = np.argsort(ends, kind="stable")
        self._firsts = np.searchsorted(ends[order], np.arange(m + 1))
        self._neighbours = np.concatenate((other, one))[order]
        self._edge_lengths = np.tile(lengths, 2)[order]
        self._num_submaps = m
        self._lengths = {}

    @property
    def _longest_way(self) -> float:
        """Beyond this, windows grow no more [m]."""
        config = self._config
        linear = config.linear_search_window - config.min_linear_search_window
        return linear / max(config.linear_drift, 1e-6) + 1.0

    def ways_from(self, submap: int) -> FloatArray:
        """Return the lengths [m] of the shortest known ways from a submap to all those known.

        Shape (m,), of the submaps when :meth:`update` was called last; empty where this one is not
        among them; inf for very long ways.
        """
        if submap >= self._num_submaps:
            return _NOTHING
        if submap not in self._lengths:
            lengths = self._lengths[submap] = np.empty(self._num_submaps)
            shortest_ways(
                self._firsts,
                self._neighbours,
                self._edge_lengths,
                submap,
                self._longest_way,
                lengths,
            )
        return self._lengths[submap]

    def windows(self, uncertain_lengths: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the linear [m] and angular [rad] search windows for uncertain lengths [m]."""
        config = self._config
        linear = config.min_linear_search_window + config.linear_drift * uncertain_lengths
        angular_deg = (
            config.min_angular_search_window_deg + config.angular_drift_deg * uncertain_lengths
        )
        return (
            np.minimum(linear, config.linear_search_window),
            np.radians(np.minimum(angular_deg, config.angular_search_window_deg)),
        )

    def take(self, submap: int, node_submap: int, uncertain_length: float) -> bool:
        """Return whether a pair that is due is to be searched, and count it if so.

        Of pairs whose relative pose is known, some are, until enough of them are found.
        """
        config = self._config
        pair = (submap, node_submap)
        if self._num_found[pair] >= config.max_closures_of_pair:
            return False
        if uncertain_length < config.bound_length:
            if self._num_sought_bound[pair] >= config.max_searches_of_bound_pair:
                return False
            self._num_sought_bound[pair] += 1
        return True

    def note_found(self, submap: int, node_submap: int) -> None:
        """Count a closure between a submap and a node inserted into another."""
        self._num_found[(submap, node_submap)] += 1
