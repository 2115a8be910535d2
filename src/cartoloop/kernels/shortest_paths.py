# SPDX-License-Identifier: Apache-2.0
"""The shortest paths from one vertex of a graph to all others, and the drift along them."""

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
    out_lengths: NDArray[np.float64],
    out_previous: NDArray[np.int64],
) -> None:
    """Write the lengths of the shortest paths from a vertex to all, and where they come from.

    Parameters
    ----------
    firsts : int64, shape (m + 1,); the edges of vertex i are ``firsts[i] <= edge < firsts[i + 1]``.
    neighbours : int64, shape (2 e,), where each edge leads; edges stand at both of their ends.
    edge_lengths : float64, shape (2 e,), not negative.
    start : the vertex.
    out_lengths : float64, shape (m,); inf where there is no path.
    out_previous : int64, shape (m,), the vertex before each on its path; itself at the start and
        where there is no path.

    Notes
    -----
    E. W. Dijkstra, A Note on Two Problems in Connexion with Graphs (1959), without a heap: O(m f)
    for f vertices that are reached but not yet settled at a time; with submaps, one after the other
    along the robot's path, f is small.
    """
    out_lengths[:] = np.inf
    for vertex in range(out_previous.shape[0]):
        out_previous[vertex] = vertex
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
            if length < out_lengths[neighbour]:
                if out_lengths[neighbour] == np.inf:
                    reached[num_reached] = neighbour
                    num_reached += 1
                out_lengths[neighbour] = length
                out_previous[neighbour] = vertex


@kernel
def drift_along_paths(
    order: NDArray[np.int64],
    lengths: NDArray[np.float64],
    previous: NDArray[np.int64],
    positions: NDArray[np.float64],
    rotation_variance: float,
    translation_variance: float,
    out_drift: NDArray[np.float64],
) -> None:
    """Write the covariance of each vertex's pose, as the first vertex of `order` knows it.

    Dead reckoning is a random walk: each metre of a path adds to the variances of heading and
    position, and an error of the heading displaces all that follows in proportion to its distance.

    Parameters
    ----------
    order : int64, shape (n,), the vertices that are reached, by the lengths of their paths.
    lengths, previous : as :func:`shortest_paths` writes them.
    positions : float64, shape (m, 2), of all vertices [m].
    rotation_variance, translation_variance : growth per metre of path [rad^2/m], [m^2/m].
    out_drift : float64, shape (m, 6), the rows of `order` are written: the upper triangle of the
        covariance of x, y, theta, axes of `positions`.
    """
    out_drift[order[0]] = 0.0
    for i in range(1, order.shape[0]):
        vertex = order[i]
        before = previous[vertex]
        length = lengths[vertex] - lengths[before]
        dx = positions[vertex, 0] - positions[before, 0]
        dy = positions[vertex, 1] - positions[before, 1]
        xx, xy, xt, yy, yt, tt = out_drift[before]
        # p' = p + theta * (-dy, dx)
        out_drift[vertex, 0] = xx - 2.0 * dy * xt + dy * dy * tt + translation_variance * length
        out_drift[vertex, 1] = xy + dx * xt - dy * yt - dx * dy * tt
        out_drift[vertex, 2] = xt - dy * tt
        out_drift[vertex, 3] = yy + 2.0 * dx * yt + dx * dx * tt + translation_variance * length
        out_drift[vertex, 4] = yt + dx * tt
        out_drift[vertex, 5] = tt + rotation_variance * length
