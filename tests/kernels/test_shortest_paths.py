# SPDX-License-Identifier: Apache-2.0
"""Path lengths are exactly those of SciPy; the drift along them is the sum over their steps."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from cartoloop.kernels.shortest_paths import drift_along_paths, shortest_paths

ROTATION_VARIANCE, TRANSLATION_VARIANCE = 2.7e-5, 0.01


def random_graph(num_vertices, num_edges, seed):
    random = np.random.default_rng(seed)
    pairs = np.unique(random.integers(num_vertices, size=(num_edges, 2)), axis=0).reshape(-1, 2)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    lengths = random.uniform(0.1, 5.0, len(pairs))
    ends = pairs.T.ravel()
    order = np.argsort(ends, kind="stable")
    firsts = np.searchsorted(ends[order], np.arange(num_vertices + 1))
    neighbours = pairs[:, ::-1].T.ravel()[order]
    # int32: the indices that old versions of dijkstra take
    rows, columns = pairs.T.astype(np.int32)
    graph = coo_array((lengths, (rows, columns)), shape=(num_vertices, num_vertices)).tocsr()
    return graph, (firsts, neighbours, np.tile(lengths, 2)[order])


def paths_from(edges, start, num_vertices):
    lengths = np.empty(num_vertices)
    previous = np.empty(num_vertices, dtype=np.int64)
    shortest_paths(*edges, start, lengths, previous)
    return lengths, previous


@settings(deadline=None)
@given(st.integers(1, 12), st.integers(0, 40), st.integers(0, 2**32 - 1))
def test_path_lengths_are_those_of_scipy(num_vertices, num_edges, seed):
    graph, edges = random_graph(num_vertices, num_edges, seed)
    for start in range(num_vertices):
        lengths, previous = paths_from(edges, start, num_vertices)
        expected = dijkstra(graph, directed=False, indices=start)
        assert lengths.tolist() == expected.tolist()
        for vertex in np.flatnonzero(np.isfinite(lengths)):
            step = graph[previous[vertex], vertex] + graph[vertex, previous[vertex]]
            assert lengths[vertex] == lengths[previous[vertex]] + step
        unreached = np.flatnonzero(np.isinf(lengths))
        assert previous[unreached].tolist() == unreached.tolist()


def reference_drift(path, positions, lengths):
    """The covariance of the last vertex: what each step adds, displaced to the end of the path."""
    covariance = np.zeros((3, 3))
    for before, after in itertools.pairwise(path):
        step = lengths[after] - lengths[before]
        dx, dy = positions[path[-1]] - positions[after]
        to_end = np.array(((1.0, 0.0, -dy), (0.0, 1.0, dx), (0.0, 0.0, 1.0)))
        added = np.diag((TRANSLATION_VARIANCE, TRANSLATION_VARIANCE, ROTATION_VARIANCE)) * step
        covariance += to_end @ added @ to_end.T
    return covariance


@settings(deadline=None)
@given(st.integers(1, 12), st.integers(0, 40), st.integers(0, 2**32 - 1))
def test_drift_is_the_sum_over_the_steps_of_a_path(num_vertices, num_edges, seed):
    _, edges = random_graph(num_vertices, num_edges, seed)
    positions = np.random.default_rng(seed).uniform(-30.0, 30.0, (num_vertices, 2))
    lengths, previous = paths_from(edges, 0, num_vertices)
    reached = np.argsort(lengths, kind="stable")[: np.isfinite(lengths).sum()]
    drift = np.full((num_vertices, 6), np.nan)
    drift_along_paths(
        reached, lengths, previous, positions, ROTATION_VARIANCE, TRANSLATION_VARIANCE, drift
    )
    for vertex in reached.tolist():
        path = [vertex]
        while path[-1] != 0:
            path.append(int(previous[path[-1]]))
        expected = reference_drift(path[::-1], positions, lengths)
        np.testing.assert_allclose(drift[vertex], expected[np.triu_indices(3)], atol=1e-9)
    assert np.isnan(drift[np.isinf(lengths)]).all()
