# SPDX-License-Identifier: Apache-2.0
"""How well a node is known in the submaps that it was inserted into."""

from __future__ import annotations

import numpy as np

from cartoloop.submaps.node import (
    BEGINNING_INFORMATION,
    MIN_ROTATION_INFORMATION,
    information_in_begun,
    is_lost,
    shows_place,
)


def test_a_match_that_leaves_the_heading_open_shows_no_place():
    assert shows_place(np.diag((0.0, 50.0, MIN_ROTATION_INFORMATION)))
    assert not shows_place(np.diag((1e6, 1e6, 0.9 * MIN_ROTATION_INFORMATION)))


def test_a_submap_is_where_the_node_is_that_begins_it():
    matched = np.diag((500.0, 800.0, 1e5))
    np.testing.assert_array_equal(information_in_begun(matched), matched)
    after_a_blind_stretch = np.diag((10.0, 10.0, 800.0))
    np.testing.assert_array_equal(
        information_in_begun(after_a_blind_stretch), BEGINNING_INFORMATION
    )


def test_a_robot_is_lost_where_nothing_measured_its_motion():
    after_a_gap = np.diag((0.04, 0.04, 0.3))
    by_odometry, blind = np.diag((0.5, 0.5, 100.0)), np.zeros((3, 3))
    matched = np.array(((0.04, 0.01, 0.0), (0.01, 0.04, 0.0), (0.0, 0.0, 0.3)))
    assert is_lost(after_a_gap)
    assert not any(map(is_lost, (by_odometry, blind, matched)))
