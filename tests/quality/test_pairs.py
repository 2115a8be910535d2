# SPDX-License-Identifier: Apache-2.0
"""Which nodes are compared with submaps, and that those far away show displacements, too."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import QualityConfig
from cartoloop.quality.examine import examine
from cartoloop.quality.pairs import MIN_DETOUR, Reach, compared_pairs, path_lengths
from cartoloop.sensor.scan_points import ScanPoints
from tests.quality.test_examine import displaced

CONFIG = QualityConfig(every_nth_node=3)


def compared(result, visit_distance=None):
    """Return the pairs of a map."""
    scans, paths = ScanPoints.of(list(result.node_points)), path_lengths(result.graph.node_poses)
    return compared_pairs(result, scans, CONFIG, paths, visit_distance=visit_distance)


def seen_from_afar(result):
    """Return the pairs that only a larger distance of visits adds."""
    pairs = compared(result, CONFIG.visit_distance)
    return pairs.take(pairs.distance >= CONFIG.nearby)


def test_nodes_that_come_back_reach_farther():
    reach = Reach(5.0, 15.0, 30.0)
    paths = np.array((0.0, 8.0, 15.0, MIN_DETOUR * 15.0 - 0.1, MIN_DETOUR * 15.0, 400.0))

    assert reach.of(paths).tolist() == [5.0, 5.0, 5.0, 5.0, 15.0, 15.0]


@pytest.mark.slow
def test_others_are_compared_nearby_as_before(two_rounds_result):
    near, pairs = compared(two_rounds_result), compared(two_rounds_result, CONFIG.visit_distance)

    assert near.distance.max() < CONFIG.nearby
    kept = pairs.take(pairs.distance < CONFIG.nearby)
    for name, column in vars(near).items():
        np.testing.assert_array_equal(getattr(kept, name), column, err_msg=name)


@pytest.mark.slow
def test_a_smaller_distance_of_visits_leaves_none_out(two_rounds_result):
    assert len(compared(two_rounds_result, 1.0)) == len(compared(two_rounds_result))


@pytest.mark.slow
def test_places_seen_from_afar_agree_in_a_right_map(two_rounds_result):
    pairs = seen_from_afar(two_rounds_result)

    assert len(pairs) >= 10
    assert pairs.path.min() >= MIN_DETOUR * CONFIG.visit_distance
    assert np.mean(pairs.contradiction) < 0.1


@pytest.mark.slow
def test_places_seen_from_afar_show_a_displacement(two_rounds_result):
    pairs = seen_from_afar(displaced(two_rounds_result, 1.0))

    assert len(pairs) >= 10
    assert np.mean(pairs.contradiction) > 0.5


@pytest.mark.slow
def test_a_map_that_is_only_seen_again_is_called_wrong(two_rounds_result):
    config = QualityConfig(nearby=0.001)

    assert examine(two_rounds_result, config).verdict == "good"
    quality = examine(displaced(two_rounds_result, 0.8), config)
    assert quality.verdict == "wrong"
    assert quality.figures["revisited_m"] == 0.0
    assert quality.figures["seen_again_m"] > 50.0
