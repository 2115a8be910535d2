# SPDX-License-Identifier: Apache-2.0
"""Path lengths are exactly those of SciPy."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from cartoloop.kernels.shortest_paths import shortest_paths


@settings(deadline=None)
@given(st.integers(1, 12), st.integers(0, 40), st.floats(0.0, 20.0), st.integers(0, 2**32 - 1))
def test_path_lengths_are_those_of_scipy(num_vertices, num_edges, limit, seed):
    random = np.random.default_rng(seed)
    pairs = np.unique(random.integers(num_vertices, size=(num_edges, 2)), axis=0).reshape(-1, 2)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    lengths = random.uniform(0.1, 5.0, len(pairs))
    ends = pairs.T.ravel()
    order = np.argsort(ends, kind="stable")
    firsts = np.searchsorted(ends[order], np.arange(num_vertices + 1))
    graph = coo_array((lengths, pairs.T), shape=(num_vertices, num_vertices)).tocsr()
    for start in range(num_vertices):
        found = np.empty(num_vertices)
        shortest_paths(
            firsts, pairs[:, ::-1].T.ravel()[order], np.tile(lengths, 2)[order], start, limit, found
        )
        expected = dijkstra(graph, directed=False, indices=start, limit=limit)
        assert found.tolist() == expected.tolist()
