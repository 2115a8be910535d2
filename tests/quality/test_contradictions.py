# SPDX-License-Identifier: Apache-2.0
"""Places that contradict each other: a displaced visit is one, people who pass by are not."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cartoloop.config import QualityConfig
from cartoloop.quality.contradictions import contradictions
from cartoloop.quality.encounters import Encounters
from cartoloop.quality.pairs import Pairs
from cartoloop.quality.verdict import Severity

CONFIG = QualityConfig()
NUM_NODES, STEP_M = 60, 0.5
PATHS = STEP_M * np.arange(NUM_NODES)
LOW_SHARE = 0.02
"""Of all encounters of a large map, most of them elsewhere."""


def corridor_visits(num_visits, contradicting, displacements):
    """Return a straight path and its encounters, `num_visits` of each of its nodes.

    `contradicting` returns from the number of an encounter whether it contradicts, and
    `displacements` by how far it is displaced.
    """
    node = np.repeat(np.arange(NUM_NODES), num_visits)
    count = len(node)
    zeros, numbers = np.zeros(count, dtype=np.int64), np.arange(count)
    pairs = Pairs(
        zeros, node, zeros, np.zeros((count, 3)), np.zeros(count), np.zeros(count), zeros, zeros
    )
    is_bad = np.array([contradicting(i) for i in range(count)])
    shift = np.array([displacements(i) for i in range(count)])
    met = Encounters(
        numbers,
        numbers + 1,
        pairs,
        np.full(count, STEP_M),
        np.where(is_bad, 0.7, 0.02),
        np.where(is_bad, shift, np.nan),
        is_bad,
    )
    poses = np.zeros((NUM_NODES, 3))
    poses[:, 0] = STEP_M * np.arange(NUM_NODES)
    content = SimpleNamespace(
        graph=SimpleNamespace(node_poses=poses),
        stamps=np.arange(NUM_NODES, dtype=np.float64),
        node_scan_index=np.arange(NUM_NODES),
    )
    return met, content


def severities(*visits):
    met, content = corridor_visits(*visits)
    return [place.severity for place in contradictions(met, LOW_SHARE, PATHS, content, CONFIG)]


@pytest.mark.parametrize("apart", [0.9, np.nan])
def test_a_long_place_of_a_displaced_visit_is_doubtful(apart):
    assert severities(10, lambda i: i % 5 == 0, lambda _: apart) == [Severity.DOUBTFUL]


@pytest.mark.parametrize("apart", [0.9, np.nan])
def test_few_of_many_visits_make_no_long_place(apart):
    assert severities(20, lambda i: i % 20 == 0, lambda _: apart) == [Severity.MINOR]


def test_a_small_displacement_makes_no_long_place():
    assert severities(10, lambda i: i % 5 == 0, lambda _: 0.3) == [Severity.MINOR]


@pytest.mark.parametrize(
    ("agrees", "severity"), [(0, Severity.DOUBTFUL), (3, Severity.MINOR)], ids=["none", "a_third"]
)
def test_a_short_place_is_doubtful_if_nothing_agrees(agrees, severity):
    def contradicting(i):
        return 20 <= i // 2 < 40 and not (agrees and i % agrees == 0)

    assert severities(2, contradicting, lambda _: np.nan) == [severity]


@pytest.mark.parametrize(
    ("every", "what"), [(2, "walls stand twice, about 0.9 m apart"), (40, "saw floor")]
)
def test_walls_stand_twice_where_enough_fits_elsewhere(every, what):
    met, content = corridor_visits(
        10, lambda i: i % 5 == 0, lambda i: 0.9 if i // 5 % every == 0 else np.nan
    )

    (place,) = contradictions(met, LOW_SHARE, PATHS, content, CONFIG)

    assert what in place.reason
