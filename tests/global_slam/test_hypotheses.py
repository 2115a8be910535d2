# SPDX-License-Identifier: Apache-2.0
"""Which matches of a wide search are believed."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import WideSearchConfig
from cartoloop.global_slam.hypotheses import (
    Candidate,
    Hypothesis,
    agreement,
    best_place,
    consistent_set,
    heaviest_clique,
)
from cartoloop.sensor.pose import compose_all

CONFIG = WideSearchConfig()
DRIFT = np.array((3.0, -2.0, 0.4))
"""tf_map_local of true hypotheses."""


def candidate(scan=0, score=0.6, other_score=0.45):
    return Candidate(scan, scan, 0, np.zeros(3), score, other_score)


def hypothesis(travelled, tf_map_local=DRIFT, evidence=0.08):
    """A hypothesis on a straight path along the local x axis."""
    local = np.array((travelled, 0.0, 0.0))
    claimed = compose_all(np.array([tf_map_local]), local[np.newaxis])[0]
    return Hypothesis(candidate(int(travelled)), claimed, local, travelled, evidence)


def test_a_match_elsewhere_in_another_submap_is_another_place():
    candidates = [candidate(score=0.6), candidate(score=0.55)]
    poses = np.array(((0.0, 0.0, 0.0), (5.0, 0.0, 0.0)))
    assert best_place(candidates, poses, CONFIG) == (0, 0.55)


def test_a_match_in_the_same_place_does_not_compete():
    candidates = [candidate(score=0.6, other_score=0.5), candidate(score=0.59, other_score=0.45)]
    poses = np.array(((0.0, 0.0, 0.0), (0.1, 0.0, 0.01)))
    assert best_place(candidates, poses, CONFIG) == (0, 0.5)


def test_a_runner_up_that_another_submap_saw_competes():
    candidates = [candidate(score=0.6, other_score=0.45), candidate(score=0.58, other_score=0.57)]
    assert best_place(candidates, np.zeros((2, 3)), CONFIG) == (0, 0.57)


def test_a_turned_match_is_another_place():
    candidates = [candidate(score=0.6), candidate(score=0.56)]
    poses = np.array(((0.0, 0.0, 0.0), (0.0, 0.0, np.pi)))
    assert best_place(candidates, poses, CONFIG) == (0, 0.56)


def test_hypotheses_agree_if_the_path_between_them_fits():
    far_off = DRIFT + np.array((0.0, 4.0, 0.0))
    turned = DRIFT + np.array((0.0, 0.0, 0.3))
    few = [hypothesis(0.0), hypothesis(4.0), hypothesis(8.0, far_off), hypothesis(12.0, turned)]
    agrees = agreement(few, CONFIG)
    assert agrees[0, 1]
    assert not agrees[0, 2]
    assert not agrees[1, 3]
    assert (agrees == agrees.T).all()


def test_hypotheses_may_drift_with_the_path_between_them():
    drifted = DRIFT + np.array((1.0, 0.0, 0.0))
    assert not agreement([hypothesis(0.0), hypothesis(4.0, drifted)], CONFIG)[0, 1]
    assert agreement([hypothesis(0.0), hypothesis(40.0, drifted)], CONFIG)[0, 1]


def heaviest_by_exhaustion(agrees, weights):
    best = -1.0
    for size in range(len(weights) + 1):
        for members in itertools.combinations(range(len(weights)), size):
            if all(agrees[i, j] for i, j in itertools.combinations(members, 2)):
                best = max(best, float(sum(weights[i] for i in members)))
    return best


@settings(deadline=None)
@given(st.integers(1, 9), st.floats(0.0, 1.0), st.integers(0, 2**32 - 1))
def test_the_heaviest_clique_is_that_of_exhaustive_search(count, share, seed):
    random = np.random.default_rng(seed)
    agrees = np.triu(random.random((count, count)) < share, 1)
    agrees = agrees | agrees.T
    weights = random.uniform(0.01, 1.0, count)
    members = heaviest_clique(agrees, weights)
    assert all(agrees[i, j] for i, j in itertools.combinations(members, 2))
    expected = heaviest_by_exhaustion(agrees, weights)
    assert float(weights[members].sum()) == pytest.approx(expected)


def test_one_hypothesis_alone_is_not_believed():
    assert consistent_set([hypothesis(0.0, evidence=0.4)], CONFIG) is None


def test_hypotheses_that_agree_are_believed_together():
    assert consistent_set([hypothesis(0.0), hypothesis(4.0)], CONFIG) is not None


def test_little_evidence_is_not_believed():
    weak = [hypothesis(0.0, evidence=0.04), hypothesis(4.0, evidence=0.04)]
    assert consistent_set(weak, CONFIG) is None


def test_the_larger_of_two_contradicting_sets_is_believed():
    wrong = (9.0, 5.0, 0.0)
    true = [hypothesis(4.0 * k) for k in (0, 2, 3, 5)]
    false = [hypothesis(4.0 * k, wrong) for k in (1, 4)]
    mixed = sorted(true + false, key=lambda each: each.travelled)
    chosen = consistent_set(mixed, CONFIG)
    assert [each.travelled for each in chosen] == [0.0, 8.0, 12.0, 20.0]


def test_hypotheses_far_apart_do_not_support_each_other():
    assert consistent_set([hypothesis(0.0), hypothesis(100.0)], CONFIG) is None
