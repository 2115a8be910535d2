# SPDX-License-Identifier: Apache-2.0
"""Places that only a few loop closures hold: one of them false, and a part of the map is elsewhere.

Loop closures between the same two stretches of the path are one *bundle*. A bundle is weak if it
has few closures, and the shortest path between its ends would be long without it.
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
"""A bundle of this number of closures is weak: the last pass adds one for each overlapping scan."""

STRETCH_M = 4.0
"""Closures whose ends are as near to each other along the path are one bundle [m]."""

MAX_EXAMINED = 100
"""Bundles of few closures that are examined."""


class WeakBundle(NamedTuple):
    """A bundle of few closures that hold a part of the map.

    Attributes
    ----------
    nodes : of its closures, and those of the submaps that they are matched to.
    num_closures : that it has.
    detour : length of the shortest path between its ends without it [m]; infinite if there is none.
    """

    nodes: IntArray
    num_closures: int
    detour: float


def weak_bundles(graph: PoseGraph, paths: FloatArray, min_detour: float) -> list[WeakBundle]:
    """Return the weak bundles, the longest detour first.

    Parameters
    ----------
    graph : as adjusted.
    paths : path length of each node [m].
    min_detour : bundles whose ends are connected by a shorter path without them hold nothing [m].
    """
    ends = _closure_ends(graph)
    if len(ends) == 0:
        return []
    stretches = np.floor(paths / STRETCH_M).astype(np.int64)
    numbers = np.cumsum(np.append(0, np.diff(stretches) > 0))
    along = paths[ends]
    bundles = clusters(np.sort(along, axis=1), STRETCH_M)
    network = _Network(paths, numbers)
    for number, bundle in enumerate(bundles):
        network.add(number, numbers[ends[bundle]])
    found = []
    few = [n for n, bundle in enumerate(bundles) if len(np.unique(ends[bundle, 1])) <= FEW]
    few = [n for n in few if np.ptp(along[bundles[n]], axis=1).max() > min_detour]
    for number in few[:MAX_EXAMINED]:
        first, last = numbers[ends[bundles[number][0]]].tolist()
        detour = network.distance(first, last, without=number)
        if detour > min_detour:
            own = ends[bundles[number]]
            found.append(WeakBundle(np.unique(own), len(np.unique(own[:, 1])), detour))
    return sorted(found, key=lambda bundle: -bundle.detour)


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
    """Stretches of the path, and the bundles between them.

    Parameters
    ----------
    paths : path length of each node [m].
    numbers : int64, of the stretch of each node, ascending.
    """

    def __init__(self, paths: FloatArray, numbers: IntArray) -> None:
        firsts = np.flatnonzero(np.append(True, np.diff(numbers) > 0))
        self._steps: list[float] = np.diff(paths[firsts]).tolist()
        self._bundles: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)

    def add(self, number: int, ends: IntArray) -> None:
        """Connect the stretches, shape (k, 2), of a bundle."""
        for one, other in np.unique(ends, axis=0).tolist():
            self._bundles[one].append((other, number))
            self._bundles[other].append((one, number))

    def distance(self, first: int, last: int, *, without: int) -> float:
        """Return the length of the shortest path between two stretches without a bundle [m]."""
        steps, bundles = self._steps, self._bundles
        shortest, front = {first: 0.0}, [(0.0, first)]
        while front:
            length, at = heappop(front)
            if at == last:
                return length
            if length > shortest[at]:
                continue
            near = [(other, length) for other, number in bundles[at] if number != without]
            if at < len(steps):
                near.append((at + 1, length + steps[at]))
            if at > 0:
                near.append((at - 1, length + steps[at - 1]))
            for other, so_far in near:
                if so_far < shortest.get(other, math.inf):
                    shortest[other] = so_far
                    heappush(front, (so_far, other))
        return math.inf
