# SPDX-License-Identifier: Apache-2.0
"""Pairs of submap and scan that show the same."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import Config
from cartoloop.errors import InputError
from cartoloop.evaluation.overlap import CELL_M, PlacedScans, closable_pairs, place_scans
from cartoloop.sensor.events import LaserScan, Odometry, ScanGeometry
from cartoloop.sensor.pose import Pose
from tests.reference import naive_overlap

GEOMETRY = ScanGeometry(-np.pi, 2 * np.pi / 360, 360, 0.1, 30.0)


def scan(stamp, ranges=2.0):
    return LaserScan(stamp, stamp, np.full(360, ranges), GEOMETRY)


def placed(hits, samples):
    def joined(parts):
        cells = np.array([cell for part in parts for cell in part], np.int32).reshape(-1, 2)
        return cells, np.cumsum([0, *map(len, parts)])

    return PlacedScans(*joined(hits), *joined(samples))


cells = st.lists(st.tuples(st.integers(-6, 6), st.integers(-6, 6)), max_size=8)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_pairs_are_those_of_the_naive_search(data):
    num_nodes, num_submaps = data.draw(st.integers(1, 6)), data.draw(st.integers(1, 4))
    hits = [data.draw(cells) for _ in range(num_nodes)]
    samples = [data.draw(cells) for _ in range(num_nodes)]
    index = st.tuples(st.integers(0, num_submaps - 1), st.integers(0, num_nodes - 1))
    own = data.draw(st.sets(index, max_size=8))
    min_num_points = data.draw(st.integers(0, 3))
    min_share = data.draw(st.sampled_from((0.25, 0.5, 1.0)))
    own_submap, own_node = np.array(sorted(own), np.int64).reshape(-1, 2).T

    pairs = closable_pairs(
        placed(hits, samples), own_submap, own_node, num_submaps, min_num_points, min_share
    )

    assert [tuple(pair) for pair in pairs.tolist()] == naive_overlap.closable_pairs(
        hits, samples, own, num_submaps, min_num_points, min_share
    )


def test_only_scans_from_one_place_overlap():
    poses = np.array([(0, 0, 0), (0.05, 0, 1.0), (0.02, 0.03, 2.0), (9, 0, 0)])
    events = [scan(float(k)) for k in range(4)]

    scans = place_scans(events, np.arange(4.0), poses, Config(), "a.log")
    pairs = closable_pairs(scans, np.array([0, 1]), np.array([0, 3]), 2, min_num_points=20)

    assert pairs.tolist() == [[0, 1], [0, 2]]


def test_points_are_exact_far_from_the_origin():
    pose = np.array((4.5e6, -5.4e6, np.pi / 2))
    poses = np.array((pose, pose))
    poses[1, 0] += 1.0

    scans = place_scans([scan(0.0), scan(1.0)], np.arange(2.0), poses, Config(), "a.log")

    for first, last, centre in ((0, 1, 0.0), (1, 2, 1.0)):
        for points, start in ((scans.hits, scans.hits_start), (scans.sample, scans.sample_start)):
            middle = (points[start[first] : start[last]] + 0.5) * CELL_M - (centre, 0.0)
            assert np.hypot(*middle.T) == pytest.approx(2.0, abs=CELL_M)
    assert np.diff(scans.sample_start).tolist() == [100, 100]


def test_other_events_are_skipped_and_stamps_may_run_back():
    odometry = Odometry(5.0, 5.0, Pose(0, 0, 0))
    events = [scan(5.0), odometry, scan(4.0), scan(4.5), scan(4.0)]

    scans = place_scans(events, np.array((5.0, 4.5, 4.0)), np.zeros((3, 3)), Config(), "a.log")

    assert len(scans) == 3


def test_recording_without_a_node_is_an_error():
    with pytest.raises(InputError, match=r"a\.log: has no scan of stamp 1\.250000 .* node 1"):
        place_scans(
            [scan(0.0), scan(1.0)], np.array((0.0, 1.25)), np.zeros((2, 3)), Config(), "a.log"
        )


def test_impossible_truth_is_an_error():
    scans = placed([[(0, 0)], [(900000, 0)]], [[(0, 0)], [(0, 0)]])

    with pytest.raises(InputError, match="scatters the scans of submap 0 over 90000 m"):
        closable_pairs(scans, np.array([0, 0]), np.array([0, 1]), 1, 1)
