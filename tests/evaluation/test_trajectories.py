# SPDX-License-Identifier: Apache-2.0
"""Reading, matching and aligning trajectories."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.errors import ConfigError, InputError
from cartoloop.evaluation.trajectories import (
    Trajectory,
    absolute_trajectory_error,
    align,
    read_tum,
)
from cartoloop.sensor.pose import Pose, compose_all, transform_points

coordinates = st.floats(-100, 100)


def trajectory_of(stamps):
    return Trajectory(np.array(stamps, dtype=float), np.zeros((len(stamps), 3)))


def test_reads_poses_and_skips_comments_and_blank_lines(tmp_path):
    half = math.radians(30) / 2
    path = tmp_path / "t.tum"
    path.write_text(f"# stamp ...\n\n12.5 1 2 0 0 0 {math.sin(half)} {math.cos(half)}\n")

    trajectory = read_tum(path)

    assert trajectory.stamps.tolist() == [12.5]
    assert trajectory.poses[0] == pytest.approx([1, 2, math.radians(30)])


def test_a_quaternion_of_few_digits_need_not_be_of_unit_length(tmp_path):
    half = math.radians(100) / 2
    path = tmp_path / "t.tum"
    path.write_text(f"1 0 0 0 0 0 {1.05 * math.sin(half)} {1.05 * math.cos(half)}\n")

    assert read_tum(path).poses[0, 2] == pytest.approx(math.radians(100))


def test_a_file_of_relations_is_not_taken_for_a_trajectory(tmp_path):
    path = tmp_path / "some.relations"
    path.write_text("# from to pose\n10.5 11.5 1 0 0 0 0 0.3\n")

    with pytest.raises(InputError, match=r"some\.relations:2: .* of length 0\.3, not 1"):
        read_tum(path)


@pytest.mark.parametrize("tolerance", [-1.0, math.nan])
def test_an_impossible_tolerance_of_stamps_is_refused(tolerance):
    with pytest.raises(ConfigError, match="give 0 s or more"):
        trajectory_of([1, 2]).find(np.array([1.0]), tolerance)


@pytest.mark.parametrize(
    "line", ["1 2 3", "1 2 3 4 5 6 7 x", "1 nan 0 0 0 0 0 1", "1 2 3 4 5 6 7 8 9"]
)
def test_a_bad_line_is_named_with_its_number(tmp_path, line):
    path = tmp_path / "t.tum"
    path.write_text(f"0 0 0 0 0 0 0 1\n{line}\n")

    with pytest.raises(InputError, match=r"t\.tum:2: expected 8 numbers"):
        read_tum(path)


def test_missing_empty_and_binary_files_are_input_errors(tmp_path):
    (tmp_path / "empty.tum").write_text("# nothing\n")
    (tmp_path / "binary.tum").write_bytes(b"\x1f\x8b\xff\x00")

    for name in ("none.tum", "empty.tum", "binary.tum"):
        with pytest.raises(InputError, match=name):
            read_tum(tmp_path / name)


def test_finds_the_nearest_stamp_within_the_tolerance():
    trajectory = trajectory_of([1.0, 2.0, 3.0])

    rows = trajectory.find(np.array([0.9, 2.04, 2.96, 2.5, 3.2, -9.0]), 0.11)

    assert rows.tolist() == [0, 1, 2, -1, -1, -1]


def test_finds_stamps_that_run_backwards_in_the_file():
    trajectory = trajectory_of([5.0, 4.5, 6.0, 5.5, 5.25])

    assert trajectory.find(np.array([4.5, 5.25, 5.5, 6.0]), 1e-3).tolist() == [1, 4, 3, 2]


def test_of_repeated_stamps_the_first_counts_from_either_side():
    trajectory = trajectory_of([2.0, 1.0, 1.0, 2.0])

    assert trajectory.find(np.array([0.999, 1.0, 1.001]), 0.01).tolist() == [1, 1, 1]


def test_of_two_equally_near_the_earlier_counts():
    assert trajectory_of([3.0, 1.0]).find(np.array([2.0]), 1.0).tolist() == [1]


def test_an_empty_trajectory_has_no_stamp():
    assert trajectory_of([]).find(np.array([1.0]), 1.0).tolist() == [-1]


@given(
    st.lists(st.floats(0, 10), min_size=1, max_size=30),
    st.lists(st.floats(-1, 11), min_size=1, max_size=10),
)
def test_finding_equals_a_linear_search(stamps, wanted):
    distance = np.abs(np.array(stamps)[None, :] - np.array(wanted)[:, None])

    rows = trajectory_of(stamps).find(np.array(wanted), 0.5)

    for row, distances in zip(rows, distance, strict=True):
        if distances.min() > 0.5:
            assert row == -1
        else:
            assert distances[row] == distances.min()
            assert row == stamps.index(stamps[row])


@given(coordinates, coordinates, st.floats(-3.1, 3.1))
def test_alignment_recovers_a_rigid_motion(x, y, theta):
    points = np.array([[0.0, 0.0], [3.0, 1.0], [-2.0, 5.0], [1.0, -4.0]])
    moved = transform_points(Pose(x, y, theta), points)

    assert align(points, moved) == pytest.approx((x, y, theta), abs=1e-9)


def test_error_is_nothing_after_alignment_of_a_moved_copy():
    truth = np.array([[0.0, 0, 0], [1, 0, 0.1], [2, 1, 0.3], [2, 3, 1.0]])
    moved = compose_all(np.array([5.0, -2.0, 1.2]), truth)

    assert absolute_trajectory_error(moved, truth) == pytest.approx(np.zeros(4), abs=1e-12)
    assert absolute_trajectory_error(moved, truth, aligned=False).min() > 1.0
