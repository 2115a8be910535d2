# SPDX-License-Identifier: Apache-2.0
"""Lengths of the shortest paths from one vertex of a graph to all others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel


@kernel
def shortest_paths(
    firsts: NDArray[np.int64],
    neighbours: NDArray[np.int64],
    edge_lengths: NDArray[np.float64],
    start: int,
    limit: float,
    out_lengths: NDArray[np.float64],
) -> None:
    """Write the lengths of the shortest paths from a vertex to all into `out_lengths`.

    Parameters
    ----------
    firsts : int64, shape (m + 1,); the edges of vertex i are ``firsts[i] <= edge < firsts[i + 1]``.
    neighbours : int64, shape (2 e,), where each edge leads; edges stand at both of their ends.
    edge_lengths : float64, shape (2 e,), not negative.
    start : the vertex.
    limit : longer paths are left out.
    out_lengths : float64, shape (m,); inf where there is no path.

    Notes
    -----
    E. W. Dijkstra, A Note on Two Problems in Connexion with Graphs (1959), without a heap: O(m f)
    for f vertices that are reached but not yet settled at a time; with submaps, one after the other
    along the robot's path, f is small.
    """
    out_lengths[:] = np.inf
    out_lengths[start] = 0.0
    reached = np.empty(len(out_lengths), dtype=np.int64)
    reached[0] = start
    num_reached = 1
    while num_reached > 0:
        nearest = 0
        for i in range(1, num_reached):
            if out_lengths[reached[i]] < out_lengths[reached[nearest]]:
                nearest = i
        vertex = reached[nearest]
        num_reached -= 1
        reached[nearest] = reached[num_reached]
        for edge in range(firsts[vertex], firsts[vertex + 1]):
            length = out_lengths[vertex] + edge_lengths[edge]
            neighbour = neighbours[edge]
            if length <= limit and length < out_lengths[neighbour]:
                if out_lengths[neighbour] == np.inf:
                    reached[num_reached] = neighbour
                    num_reached += 1
                out_lengths[neighbour] = length
