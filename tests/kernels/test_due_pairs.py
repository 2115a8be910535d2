# SPDX-License-Identifier: Apache-2.0
"""Pairs that are due to be searched, against the reference."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.due_pairs import (
    NodePlace,
    PairRule,
    Paths,
    nearest_anchor,
    pairs_of_node,
    pairs_of_submap,
)
from tests.reference.naive_due_pairs import naive_anchor, naive_pair

NUM_SUBMAPS, NUM_NODES = 6, 40


def poses(rng, count):
    return np.column_stack((rng.uniform(-6, 6, (count, 2)), rng.uniform(-3.1, 3.1, count)))


class Walk:
    """A random graph: each node in one or two submaps, some of them found in others."""

    def __init__(self, rng):
        self.submap_poses, self.node_poses = poses(rng, NUM_SUBMAPS), poses(rng, NUM_NODES)
        travelled = np.cumsum(rng.uniform(0.0, 1.0, NUM_NODES))
        first = np.sort(rng.integers(0, NUM_SUBMAPS - 1, NUM_NODES))
        node_submaps = np.column_stack((first, first + rng.integers(0, 2, NUM_NODES)))
        begun = np.searchsorted(first, np.arange(NUM_SUBMAPS)).clip(max=NUM_NODES - 1)
        count = int(rng.integers(0, 9))
        closed = np.sort(rng.choice(NUM_NODES, count))
        closures = np.array((closed, rng.integers(0, NUM_SUBMAPS, count)))
        self.paths = Paths(travelled, node_submaps, travelled[begun], closures, 0.5)

    def expected(self, submaps, nodes, known_length, rule):
        """known_length : of a submap and an anchor."""
        rows = [
            naive_pair(
                submap,
                node,
                self.submap_poses,
                self.node_poses,
                self.paths,
                known_length(submap, naive_anchor(node, self.paths)[0]),
                rule,
            )
            for submap in submaps
            for node in nodes
        ]
        return np.array([row for row in rows if row is not None]).reshape(-1, 6)


RULES = st.builds(
    PairRule,
    st.just(5.0),
    st.sampled_from((8.0, math.inf)),
    st.just(6.0),
    st.integers(1, 4),
    st.integers(1, 4),
)


def known_lengths(rng, num_known):
    lengths = rng.uniform(0.0, 12.0, num_known)
    lengths[rng.random(num_known) < 0.2] = np.inf
    return lengths


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_anchor_is_that_of_the_reference(seed):
    walk = Walk(np.random.default_rng(seed))
    for node in range(NUM_NODES):
        assert nearest_anchor(node, *walk.paths) == naive_anchor(node, walk.paths)


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), num_known=st.integers(0, NUM_SUBMAPS), rule=RULES)
def test_pairs_of_a_node_are_those_of_the_reference(seed, num_known, rule):
    rng = np.random.default_rng(seed)
    walk = Walk(rng)
    node, known = int(rng.integers(NUM_NODES)), known_lengths(rng, num_known)
    anchor, length = nearest_anchor(node, *walk.paths)
    place = NodePlace(
        node,
        *walk.node_poses[node].tolist(),
        float(walk.paths.travelled[node]),
        *walk.paths.node_submaps[node].tolist(),
        anchor,
        length,
    )
    submaps, lengths = np.empty(NUM_SUBMAPS, np.int32), np.empty(NUM_SUBMAPS)
    seen = np.empty((NUM_SUBMAPS, 3))

    num_due = pairs_of_node(
        place, NUM_SUBMAPS, walk.submap_poses, walk.paths.submap_travelled, known, rule,
        submaps, lengths, seen,
    )  # fmt: skip

    def known_length(submap, anchor):
        return known[submap] if max(submap, anchor) < num_known else None

    expected = walk.expected(range(NUM_SUBMAPS), [node], known_length, rule)
    found = np.column_stack((submaps, np.full(NUM_SUBMAPS, node), lengths, seen))[:num_due]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), num_known=st.integers(0, NUM_SUBMAPS), rule=RULES)
def test_pairs_of_a_submap_are_those_of_the_reference(seed, num_known, rule):
    rng = np.random.default_rng(seed)
    walk = Walk(rng)
    submap, known = int(rng.integers(NUM_SUBMAPS)), known_lengths(rng, num_known)
    is_searchable = rng.random(NUM_NODES) < 0.9
    nodes, lengths = np.empty(NUM_NODES, np.int32), np.empty(NUM_NODES)
    seen = np.empty((NUM_NODES, 3))

    num_due = pairs_of_submap(
        submap, walk.submap_poses[submap], walk.node_poses, is_searchable, walk.paths, known, rule,
        nodes, lengths, seen,
    )  # fmt: skip

    def known_length(submap, anchor):
        return known[anchor] if max(submap, anchor) < num_known else None

    searchable = np.flatnonzero(is_searchable).tolist()
    expected = walk.expected([submap], searchable, known_length, rule)
    found = np.column_stack((np.full(NUM_NODES, submap), nodes, lengths, seen))[:num_due]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
