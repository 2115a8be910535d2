# SPDX-License-Identifier: Apache-2.0
"""Pairs that are due to be searched, against the reference."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.due_pairs import due_pairs, nearest_tie
from tests.reference.naive_due_pairs import naive_due_pairs, naive_tie

NUM_SUBMAPS, NUM_NODES = 6, 40


def poses(rng, count):
    return np.column_stack((rng.uniform(-6, 6, (count, 2)), rng.uniform(-3.1, 3.1, count)))


class Walk:
    """A random graph: each node in one or two submaps, some of them tied to others."""

    def __init__(self, rng):
        self.submap_poses, self.node_poses = poses(rng, NUM_SUBMAPS), poses(rng, NUM_NODES)
        self.travelled = np.cumsum(rng.uniform(0.0, 1.0, NUM_NODES))
        first = np.sort(rng.integers(0, NUM_SUBMAPS - 1, NUM_NODES))
        self.node_submaps = np.column_stack((first, first + rng.integers(0, 2, NUM_NODES)))
        begun = np.searchsorted(first, np.arange(NUM_SUBMAPS)).clip(max=NUM_NODES - 1)
        self.submap_travelled = self.travelled[begun]
        count = int(rng.integers(0, 9))
        tied = np.sort(rng.choice(NUM_NODES, count))
        self.ties = np.array((tied, rng.integers(0, NUM_SUBMAPS, count)))

    @property
    def known(self):
        return self.travelled, self.node_submaps, self.submap_travelled, self.ties, 0.5


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_node_is_tied_to_its_own_submap_or_where_the_nearest_one_closed_a_loop(seed):
    walk = Walk(np.random.default_rng(seed))
    for node in range(NUM_NODES):
        assert nearest_tie(node, *walk.known) == naive_tie(node, *walk.known)


@settings(deadline=None, max_examples=80)
@given(
    seed=st.integers(0, 2**32 - 1),
    num_known=st.integers(0, NUM_SUBMAPS),
    of_submap=st.booleans(),
    every=st.integers(1, 4),
    every_bound=st.integers(1, 4),
)
def test_pairs_are_due_as_by_the_reference(seed, num_known, of_submap, every, every_bound):
    rng = np.random.default_rng(seed)
    walk = Walk(rng)
    ways = rng.uniform(0.0, 12.0, num_known)
    ways[rng.random(num_known) < 0.2] = np.inf
    one_submap, one_node = int(rng.integers(NUM_SUBMAPS)), int(rng.integers(NUM_NODES))
    submaps = (one_submap, one_submap + 1) if of_submap else (0, NUM_SUBMAPS)
    nodes = (0, NUM_NODES) if of_submap else (one_node, one_node + 1)
    graph = (walk.submap_poses, walk.node_poses, 5.0, rng.random(NUM_NODES) < 0.9, *walk.known)
    rest = (ways, of_submap, 6.0, every, every_bound)
    count = NUM_SUBMAPS * NUM_NODES
    pairs, lengths, seen = np.empty((count, 3), np.int64), np.empty(count), np.empty((count, 3))

    num_due = due_pairs(*submaps, *nodes, *graph, *rest, pairs, lengths, seen)

    expected = naive_due_pairs(range(*submaps), range(*nodes), *graph, *rest)
    found = np.column_stack((pairs, lengths, seen))[:num_due]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
