# SPDX-License-Identifier: Apache-2.0
"""Places that only a few loop closures hold: one of them false, and a part of the map is elsewhere.

Loop closures between the same two stretches of the path are one *tie*. A tie is weak if it has few
closures, and its ends would otherwise be connected by a long way only.
"""

from __future__ import annotations

import math
from collections import defaultdict
from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.quality.clusters import clusters

FEW = 3
"""A tie of so many closures is weak: the last pass adds one for each scan that overlaps."""

STRETCH_M = 4.0
"""Closures whose ends are as near to each other along the path are one tie [m]."""

MAX_EXAMINED = 100
"""Ties of few closures that are examined."""


class Tie(NamedTuple):
    """A weak tie.

    Attributes
    ----------
    nodes : of its closures, and those of the submaps that they are matched to.
    num_closures : that it has.
    way : length of the shortest way between its ends without it [m]; infinite if there is none.
    """

    nodes: IntArray
    num_closures: int
    way: float


def weak_ties(graph: PoseGraph, paths: FloatArray, min_way: float) -> list[Tie]:
    """Return the weak ties, the longest way first.

    Parameters
    ----------
    graph : as adjusted.
    paths : path length of each node [m].
    min_way : ties whose ends are connected by a shorter way without them hold nothing [m].
    """
    ends = _closure_ends(graph)
    if len(ends) == 0:
        return []
    stretches = np.floor(paths / STRETCH_M).astype(np.int64)
    numbers = np.cumsum(np.append(0, np.diff(stretches) > 0))
    along = paths[ends]
    ties = clusters(np.sort(along, axis=1), STRETCH_M)
    network = _Network(paths, numbers)
    for number, tie in enumerate(ties):
        network.tie(number, numbers[ends[tie]])
    found = []
    few = [number for number, tie in enumerate(ties) if len(np.unique(ends[tie, 1])) <= FEW]
    few = [n for n in few if np.ptp(along[ties[n]], axis=1).max() > min_way]
    for number in few[:MAX_EXAMINED]:
        first, last = numbers[ends[ties[number][0]]].tolist()
        way = network.way(first, last, without=number)
        if way > min_way:
            own = ends[ties[number]]
            found.append(Tie(np.unique(own), len(np.unique(own[:, 1])), way))
    return sorted(found, key=lambda tie: -tie.way)


def _closure_ends(graph: PoseGraph) -> IntArray:
    """Return two nodes for each closure, (k, 2): the nearest one of the submap, and its own."""
    is_closure = graph.kinds == ConstraintKind.LOOP_CLOSURE
    is_own = graph.kinds == ConstraintKind.INTRA_SUBMAP
    places = graph.node_poses[:, :2]
    ends = []
    for submap in np.unique(graph.index_a[is_closure]).tolist():
        own = graph.index_b[is_own & (graph.index_a == submap)]
        nodes = graph.index_b[is_closure & (graph.index_a == submap)]
        if len(own):
            apart = places[nodes, np.newaxis] - places[own]
            nearest = own[np.einsum("ijk,ijk->ij", apart, apart).argmin(axis=1)]
            ends.append(np.column_stack((nearest, nodes)))
    return np.concatenate(ends) if ends else np.zeros((0, 2), np.int64)


class _Network:
    """Stretches of the path, and the ties between them.

    Parameters
    ----------
    paths : path length of each node [m].
    numbers : int64, of the stretch of each node, ascending.
    """

    def __init__(self, paths: FloatArray, numbers: IntArray) -> None:
        firsts = np.flatnonzero(np.append(True, np.diff(numbers) > 0))
        self._steps: list[float] = np.diff(paths[firsts]).tolist()
        self._ties: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)

    def tie(self, number: int, ends: IntArray) -> None:
        """Connect the stretches, shape (k, 2), of a tie."""
        for one, other in np.unique(ends, axis=0).tolist():
            self._ties[one].append((other, number))
            self._ties[other].append((one, number))

    def way(self, first: int, last: int, *, without: int) -> float:
        """Return the length of the shortest way between two stretches without a tie [m]."""
        steps, ties = self._steps, self._ties
        shortest, front = {first: 0.0}, [(0.0, first)]
        while front:
            length, at = heappop(front)
            if at == last:
                return length
            if length > shortest[at]:
                continue
            near = [(other, length) for other, number in ties[at] if number != without]
            if at < len(steps):
                near.append((at + 1, length + steps[at]))
            if at > 0:
                near.append((at - 1, length + steps[at - 1]))
            for other, so_far in near:
                if so_far < shortest.get(other, math.inf):
                    shortest[other] = so_far
                    heappush(front, (so_far, other))
        return math.inf
