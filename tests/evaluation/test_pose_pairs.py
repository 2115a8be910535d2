# SPDX-License-Identifier: Apache-2.0
"""Poses that are so and so far apart."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.errors import ConfigError
from cartoloop.evaluation.pose_pairs import DELTA_TOLERANCE, frame_pairs, span_pairs

# Steps of eighths are exact, and often nothing, as of a robot that stands.
places = st.lists(st.integers(0, 6), max_size=25).map(
    lambda steps: np.concatenate(([0.0], np.cumsum(np.array(steps, dtype=float) / 8)))
)


def pairs_of(found):
    return list(zip(found[0].tolist(), found[1].tolist(), strict=True))


def nearest_pairs_by_trying_all(places, delta):
    pairs = []
    for first in range(len(places) - 1):
        off = [abs(places[j] - places[first] - delta) for j in range(first + 1, len(places))]
        if min(off) <= DELTA_TOLERANCE * delta:
            pairs.append((first, first + 1 + off.index(min(off))))
    return pairs


def consecutive_pairs_by_walking(places, delta):
    ends = [0]
    for index in range(1, len(places)):
        if places[index] - places[ends[-1]] >= delta:
            ends.append(index)
    return list(itertools.pairwise(ends))


@given(places, st.sampled_from([0.125, 0.5, 0.625, 1.0, 2.5]))
def test_spans_from_every_pose_equal_those_found_by_trying_all(places, delta):
    found = pairs_of(span_pairs(places, delta, all_pairs=True))

    assert found == nearest_pairs_by_trying_all(places, delta)


@given(places, st.sampled_from([0.125, 0.5, 0.625, 1.0, 2.5]))
def test_consecutive_spans_equal_those_found_by_walking(places, delta):
    found = pairs_of(span_pairs(places, delta, all_pairs=False))

    assert found == consecutive_pairs_by_walking(places, delta)


def test_spans_from_every_pose_end_nearest_to_the_delta():
    places = np.array([0.0, 0.5, 0.98, 1.05, 3.0])

    # 0 -> 0.98; 0.5 has none within a tenth of a metre; 0.98 and 1.05 neither
    assert pairs_of(span_pairs(places, 1.0, all_pairs=True)) == [(0, 2)]


def test_span_ends_at_the_first_pose_of_a_standing_robot():
    places = np.array([0.0, 0.0, 1.0, 1.0, 1.0])

    assert pairs_of(span_pairs(places, 1.0, all_pairs=True)) == [(0, 2), (1, 2)]


def test_frames_are_counted():
    assert pairs_of(frame_pairs(6, 2, all_pairs=True)) == [(0, 2), (1, 3), (2, 4), (3, 5)]
    assert pairs_of(frame_pairs(6, 2, all_pairs=False)) == [(0, 2), (2, 4)]
    assert pairs_of(frame_pairs(2, 2, all_pairs=True)) == []


@pytest.mark.parametrize("delta", [0, -1, 1.5, np.inf, np.nan])
def test_impossible_numbers_of_frames_are_refused(delta):
    with pytest.raises(ConfigError, match="whole number"):
        frame_pairs(6, delta, all_pairs=True)


@pytest.mark.parametrize("delta", [0.0, -1.0, np.inf, np.nan])
@pytest.mark.parametrize("all_pairs", [True, False])
def test_impossible_spans_are_refused(delta, all_pairs):
    with pytest.raises(ConfigError, match="above 0"):
        span_pairs(np.array([0.0, 1.0]), delta, all_pairs=all_pairs)
