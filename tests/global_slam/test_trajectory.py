# SPDX-License-Identifier: Apache-2.0
"""A pose for every scan out of the poses of the nodes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.global_slam.trajectory import STRIDE_M, optimized_trajectory, path_length
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles


def random_poses(rng, count, spread=20.0):
    return np.column_stack(
        (rng.uniform(-spread, spread, (count, 2)), rng.uniform(-math.pi, math.pi, count))
    )


def random_case(seed, num_scans, num_nodes):
    """Local poses, which scans are nodes, and where these ended up."""
    rng = np.random.default_rng(seed)
    index = np.sort(rng.choice(num_scans, size=min(num_nodes, num_scans), replace=False))
    return random_poses(rng, num_scans), index, random_poses(rng, len(index))


cases = {
    "seed": st.integers(0, 2**32 - 1),
    "num_scans": st.integers(1, 30),
    "num_nodes": st.integers(1, 8),
}


@settings(deadline=None, max_examples=60)
@given(**cases)
def test_nodes_keep_their_poses_to_the_last_bit(seed, num_scans, num_nodes):
    local, index, nodes = random_case(seed, num_scans, num_nodes)
    assert np.array_equal(optimized_trajectory(local, index, nodes)[index], nodes)


@settings(deadline=None, max_examples=60)
@given(**cases)
def test_a_rigid_move_of_all_nodes_moves_all_scans_alike(seed, num_scans, num_nodes):
    local, index, _ = random_case(seed, num_scans, num_nodes)
    move = random_poses(np.random.default_rng(seed + 1), 1)[0]
    moved = compose_all(move, local)
    found = optimized_trajectory(local, index, moved[index])
    assert found[:, :2] == pytest.approx(moved[:, :2], abs=1e-9)
    assert wrap_angles(found[:, 2] - moved[:, 2]) == pytest.approx(0.0, abs=1e-12)


@settings(deadline=None, max_examples=60)
@given(**cases)
def test_scans_outside_the_nodes_move_with_the_nearest_node(seed, num_scans, num_nodes):
    local, index, nodes = random_case(seed, num_scans, num_nodes)
    found = optimized_trajectory(local, index, nodes)
    for node, scans in ((0, slice(0, index[0])), (-1, slice(index[-1], None))):
        expected = relative_all(local[index[node]], local[scans])
        kept = relative_all(nodes[node], found[scans])
        assert kept[:, :2] == pytest.approx(expected[:, :2], abs=1e-9)
        assert wrap_angles(kept[:, 2] - expected[:, 2]) == pytest.approx(0.0, abs=1e-9)


@settings(deadline=None, max_examples=60)
@given(**cases)
def test_all_angles_are_within_one_turn(seed, num_scans, num_nodes):
    found = optimized_trajectory(*random_case(seed, num_scans, num_nodes))
    assert ((found[:, 2] > -math.pi) & (found[:, 2] <= math.pi)).all()


def test_scans_between_nodes_share_the_correction_evenly():
    local = np.column_stack((np.arange(5.0), np.zeros(5), np.zeros(5)))
    nodes = np.array([(0.0, 0.0, 0.0), (4.0, 0.8, 0.0)])  # the second has moved aside
    found = optimized_trajectory(local, np.array([0, 4]), nodes)
    assert found[:, 0] == pytest.approx(np.arange(5.0))
    assert found[:, 1] == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8])


def test_a_steady_error_of_the_heading_is_undone():
    angles = np.linspace(0.0, 0.4, 60)  # the odometry veers on a straight way
    local = np.column_stack((100.0 * np.sin(angles), 100.0 * (1.0 - np.cos(angles)), angles))
    nodes = np.array([(0.0, 0.0, 0.0), (40.0, 0.0, 0.0)])
    found = optimized_trajectory(local, np.array([0, 59]), nodes)
    assert found[:, 0] == pytest.approx(100.0 * angles, abs=0.02)
    assert found[:, 1] == pytest.approx(0.0, abs=0.02)
    assert found[:, 2] == pytest.approx(0.0, abs=1e-9)


def test_a_robot_that_stands_takes_no_share():
    local = np.array([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 0.0, 0.0), (4.0, 0.0, 0.0)])
    nodes = np.array([(0.0, 0.0, 0.0), (4.0, 0.8, 0.0)])
    found = optimized_trajectory(local, np.array([0, 3]), nodes)
    assert found[:, 1] == pytest.approx([0.0, 0.4, 0.4, 0.8])


def test_a_turn_between_two_nodes_is_shared_the_shorter_way():
    local = np.zeros((3, 3))
    nodes = np.array([(0.0, 0.0, 3.0), (0.0, 0.0, -3.0)])
    found = optimized_trajectory(local, np.array([0, 2]), nodes)
    assert abs(found[1, 2]) == pytest.approx(math.pi)


def test_without_nodes_the_local_poses_stand():
    local = random_poses(np.random.default_rng(3), 4)
    none = np.zeros(0, dtype=np.int64)
    found = optimized_trajectory(local, none, np.zeros((0, 3)))
    assert np.array_equal(found, local)
    assert found is not local


def test_without_scans_there_is_no_trajectory():
    none = np.zeros(0, dtype=np.int64)
    assert optimized_trajectory(np.zeros((0, 3)), none, np.zeros((0, 3))).shape == (0, 3)


def on_a_circle(count):
    angles = np.linspace(0.0, math.tau, count)
    return np.column_stack((np.cos(angles), np.sin(angles), angles))


@pytest.mark.parametrize("count", [100, 1000, 7000])
def test_path_length_does_not_depend_on_the_scan_rate(count):
    assert path_length(on_a_circle(count)) == pytest.approx(math.tau, rel=0.01)


def test_what_poses_differ_by_from_scan_to_scan_is_no_way():
    poses = on_a_circle(1000)
    poses[::2, 0] += 0.04
    poses[1::2, 1] -= 0.04
    assert path_length(poses) == pytest.approx(math.tau, rel=0.15)
    assert path_length(0.02 * random_poses(np.random.default_rng(1), 50, 1.0)) < STRIDE_M


def test_long_steps_and_the_last_step_are_counted():
    assert path_length(np.array([(0.0, 0.0, 1.0), (3.0, 4.0, 0.0), (3.0, 4.05, 0.0)])) == (
        pytest.approx(5.05)
    )
    assert path_length(np.zeros((0, 3))) == path_length(np.zeros((1, 3))) == 0.0
