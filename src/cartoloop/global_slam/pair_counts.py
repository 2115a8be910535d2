# SPDX-License-Identifier: Apache-2.0
"""How many searches between two submaps are enough, and how many closures."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import ConstraintSearchConfig

_Indices = NDArray[np.integer]


class PairCounts:
    """Counts searches and loop closures by submap, and by the first submap of the node.

    Parameters
    ----------
    config : the limits.
    """

    def __init__(self, config: ConstraintSearchConfig) -> None:
        self._config = config
        self._num_found: Counter[tuple[int, int]] = Counter()
        self._num_searches: Counter[tuple[int, int]] = Counter()

    def note_found(self, submaps: _Indices, node_submaps: _Indices) -> None:
        """Note loop closures that searches found."""
        self._num_found.update(_pairs(submaps, node_submaps))

    def note_searched(
        self, submaps: _Indices, node_submaps: _Indices, linear_window: FloatArray
    ) -> None:
        """Note earlier searches, whose window [m] shows how well constrained their pairs were."""
        config = self._config
        drift = linear_window - config.min_linear_search_window
        known_well = drift < config.well_constrained_length * config.linear_drift
        self._num_searches.update(_pairs(submaps[known_well], node_submaps[known_well]))

    def has_enough_closures(self, pair: tuple[int, int]) -> bool:
        """Return whether no more closures between two submaps are wanted."""
        return self._num_found[pair] >= self._config.max_closures_of_pair

    def has_enough_searches(self, pair: tuple[int, int], path_length: float) -> bool:
        """Return whether two submaps are well constrained, and were searched often enough.

        Parameters
        ----------
        path_length : of the shortest known path between submap and node [m].
        """
        config = self._config
        return (
            path_length < config.well_constrained_length
            and self._num_searches[pair] >= config.max_searches_of_well_constrained_pair
        )

    def take(self, submaps: _Indices, node_submaps: _Indices, path_lengths: FloatArray) -> IntArray:
        """Return the indices of the pairs to be searched, in order, and count them.

        Parameters
        ----------
        submaps, node_submaps : of the pairs that are due otherwise, shape (n,).
        path_lengths : of the shortest known paths between submap and node, shape (n,) [m].
        """
        pairs = zip(_pairs(submaps, node_submaps), path_lengths.tolist(), strict=True)
        taken = [i for i, (pair, length) in enumerate(pairs) if self._take(pair, length)]
        return np.array(taken, dtype=np.int64)

    def _take(self, pair: tuple[int, int], path_length: float) -> bool:
        if self.has_enough_closures(pair) or self.has_enough_searches(pair, path_length):
            return False
        if path_length < self._config.well_constrained_length:
            self._num_searches[pair] += 1
        return True


def _pairs(submaps: _Indices, node_submaps: _Indices) -> zip[tuple[int, int]]:
    return zip(submaps.tolist(), node_submaps.tolist(), strict=True)
