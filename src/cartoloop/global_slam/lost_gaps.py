# SPDX-License-Identifier: Apache-2.0
"""Gaps of the recording in which the robot was lost, as long paths for the wide search.

The other search goes on as if the match after such a gap were right. The closures that it finds
across the gap prove nothing: it looked where the match is.
"""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.submap_paths import LOST_M
from cartoloop.growing_array import GrowingArray
from cartoloop.kernels.due_pairs import NodePlace


class LostGaps:
    """How long a path the gaps before each submap count for."""

    def __init__(self) -> None:
        self._before_submap = GrowingArray((), np.float64)
        self._number = 0

    def __bool__(self) -> bool:
        """Whether there is any."""
        return self._number > 0

    @property
    def before_submap(self) -> FloatArray:
        """Length of the gaps before each submap was begun, shape (m,) [m]."""
        return self._before_submap.view

    def add(self) -> None:
        """Add a gap: submaps that are begun from now on come after it."""
        self._number += 1

    def add_submap(self) -> None:
        """Note that a submap was begun."""
        self._before_submap.append(LOST_M * self._number)

    def own_submaps(self, node_submaps: IntArray) -> IntArray:
        """Return of each node the submap on its side of the gap, shape (n,).

        The first node after a gap is in submaps on both sides.

        Parameters
        ----------
        node_submaps : shape (n, 2), the first and the last that each was inserted into.
        """
        first, last = node_submaps.T
        before = self.before_submap
        own: IntArray = np.where(before[first] == before[last], first, last)
        return own

    def are_across(self, submaps: IntArray, others: IntArray) -> BoolArray:
        """Return whether a gap is between the two submaps of each pair, shape (n,)."""
        before = self.before_submap
        across: BoolArray = before[submaps] != before[others]
        return across

    def lengthened(self, place: NodePlace, submap_travelled: FloatArray) -> NodePlace:
        """Return a node's place on a path with the gaps.

        Parameters
        ----------
        place : on the path without them.
        submap_travelled : on that path, when each submap was begun, shape (m,) [m].
        """
        before, own = self.before_submap, place.last_submap
        longer = place._replace(travelled=place.travelled + float(before[own]))
        if before[place.anchor] == before[own]:
            return longer
        # A closure of a node before a gap says nothing about one after it.
        length = abs(place.travelled - float(submap_travelled[own]))
        return longer._replace(anchor=own, anchor_length=length)
