# SPDX-License-Identifier: Apache-2.0
"""ATE and RPE."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.errors import InputError
from cartoloop.evaluation.trajectories import Trajectory
from cartoloop.evaluation.trajectory_error import absolute_error, evaluate_trajectory, match
from cartoloop.sensor.pose import compose_all

motions = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1)).map(np.array)

# 1 m a second along x, then along y.
STAMPS = np.arange(5.0)
TRUTH = Trajectory(
    STAMPS,
    np.array([[0, 0, 0], [1, 0, 0], [2, 0, math.pi / 2], [2, 1, math.pi / 2], [2, 2, math.pi / 2]]),
)


def noisy(seed, truth=TRUTH):
    noise = np.random.default_rng(seed).normal(size=truth.poses.shape) * (0.05, 0.05, 0.02)
    return Trajectory(truth.stamps, truth.poses + noise)


def summary(error):
    """Return all numbers of an error but how it was aligned."""
    found = error.to_dict()
    return [
        found[metric][part][name]
        for metric in ("ate", "rpe")
        for part in ("translation", "rotation_deg")
        for name in ("rmse", "mean", "median", "std", "min", "max", "p50", "p90", "p99")
    ]


def test_absolute_error_agrees_with_a_case_computed_by_hand():
    shift = np.array([[0, 0, 0], [0.3, 0.4, 0], [0, 0, 0.1], [0, -1, 0], [0, 0, -0.2]])

    error = absolute_error(match(Trajectory(STAMPS, TRUTH.poses + shift), TRUTH))

    assert error.translation == pytest.approx([0, 0.5, 0, 1.0, 0])
    assert error.rotation_deg == pytest.approx(np.degrees([0, 0, 0.1, 0, 0.2]))


def test_alignment_spreads_the_error():
    # Of two poses the estimate is 2 m long, the truth 1 m: half a metre is left over at each end.
    truth = Trajectory(STAMPS[:2], np.array([[0, 0, 0], [0, 1, 0]]))
    estimate = Trajectory(STAMPS[:2], np.array([[5, 5, 0], [7, 5, 0]]))

    error = evaluate_trajectory(estimate, truth, delta=1, delta_unit="frames")

    assert error.absolute.translation == pytest.approx([0.5, 0.5])
    assert error.tf_truth_estimate.theta == pytest.approx(math.pi / 2)
    assert error.absolute.rotation_deg == pytest.approx([90, 90])


def test_relative_error_agrees_with_a_case_computed_by_hand():
    # Before the corner the estimate goes 1.1 m a second, at the corner it turns by 80 deg.
    turned = math.radians(80)
    cos, sin = math.cos(turned), math.sin(turned)
    estimate = Trajectory(
        STAMPS,
        np.array(
            [
                [0, 0, 0],
                [1.1, 0, 0],
                [2.2, 0, turned],
                [2.2 + cos, sin, turned],
                [2.2 + 2 * cos, 2 * sin, turned],
            ]
        ),
    )

    error = evaluate_trajectory(estimate, TRUTH, delta=1, delta_unit="frames").relative

    assert error.translation == pytest.approx([0.1, 0.1, 0, 0], abs=1e-12)
    assert error.rotation_deg == pytest.approx([0, 10, 0, 0], abs=1e-9)
    assert error.stamps.tolist() == [1, 2, 3, 4]


def test_error_of_the_truth_is_nothing():
    assert summary(evaluate_trajectory(TRUTH, TRUTH)) == pytest.approx([0.0] * 36, abs=1e-9)


@given(motions, st.integers(0, 100), st.sampled_from(["m", "s", "frames"]))
def test_a_rigid_motion_of_the_estimate_changes_nothing(motion, seed, unit):
    # 1.05 m is not the same distance to two poses: rounding must not choose another pair.
    delta = 1.05 if unit == "m" else 1.0
    estimate = noisy(seed, DENSE)
    moved = Trajectory(estimate.stamps, compose_all(motion, estimate.poses))

    there = evaluate_trajectory(moved, DENSE, delta=delta, delta_unit=unit, pairs_from="truth")
    here = evaluate_trajectory(estimate, DENSE, delta=delta, delta_unit=unit, pairs_from="truth")

    assert summary(there) == pytest.approx(summary(here), abs=1e-9)


def test_only_the_absolute_error_depends_on_alignment():
    moved = Trajectory(STAMPS, TRUTH.poses + np.array([3.0, 4.0, 0.0]))

    error = evaluate_trajectory(moved, TRUTH, aligned=False)

    assert error.absolute.translation == pytest.approx([5.0] * 5)
    assert error.relative.translation == pytest.approx([0.0] * 4, abs=1e-12)


def test_the_order_of_the_lines_of_the_truth_does_not_count():
    order = [3, 0, 4, 2, 1]
    estimate = noisy(1)

    shuffled = Trajectory(STAMPS[order], TRUTH.poses[order])
    error = evaluate_trajectory(estimate, shuffled)

    assert summary(error) == pytest.approx(summary(evaluate_trajectory(estimate, TRUTH)))


def test_of_repeated_stamps_the_first_pose_counts():
    again = Trajectory(
        np.append(TRUTH.stamps, TRUTH.stamps), np.vstack((TRUTH.poses, TRUTH.poses + 9.0))
    )

    assert match(TRUTH, again).truth.tolist() == TRUTH.poses.tolist()


def test_poses_without_a_partner_are_left_out():
    estimate = Trajectory(np.array([0.0, 1.004, 1.5, 2.02]), TRUTH.poses[:4])

    matched = match(estimate, TRUTH, 0.01)

    assert matched.stamps.tolist() == [0.0, 1.004]
    assert matched.truth.tolist() == TRUTH.poses[:2].tolist()


def test_the_shorter_trajectory_chooses_its_partners():
    few = Trajectory(np.array([1.0, 3.0]), TRUTH.poses[[1, 3]])

    assert match(few, TRUTH).stamps.tolist() == [1.0, 3.0]
    assert match(TRUTH, few).stamps.tolist() == [1.0, 3.0]
    assert match(TRUTH, few).estimate.tolist() == TRUTH.poses[[1, 3]].tolist()


def test_spans_of_seconds_follow_the_time_not_the_file():
    order = [0, 2, 1, 3, 4]
    estimate = noisy(2)
    shuffled = Trajectory(STAMPS[order], estimate.poses[order])

    straight = evaluate_trajectory(estimate, TRUTH, delta=2.0, delta_unit="s").relative
    error = evaluate_trajectory(shuffled, TRUTH, delta=2.0, delta_unit="s").relative

    assert error.stamps.tolist() == straight.stamps.tolist() == [2, 3, 4]
    assert error.translation == pytest.approx(straight.translation)


def test_metres_can_be_measured_along_the_truth():
    # The estimate believes it went half as far, so that its metre takes twice the poses.
    half = Trajectory(STAMPS, TRUTH.poses * (0.5, 0.5, 1.0))

    by_estimate = evaluate_trajectory(half, TRUTH).relative
    by_truth = evaluate_trajectory(half, TRUTH, pairs_from="truth").relative

    assert by_estimate.stamps.tolist() == [2, 3, 4]
    assert by_truth.stamps.tolist() == [1, 2, 3, 4]


def test_without_a_common_moment_it_is_an_input_error():
    other = Trajectory(STAMPS + 100.0, TRUTH.poses)

    with pytest.raises(InputError, match=r"100\.000 to 104\.000 s.*same recording"):
        evaluate_trajectory(other, TRUTH)


def test_stamps_that_are_none_do_not_fill_the_line():
    other = Trajectory(STAMPS * 1e300 + 1e300, TRUTH.poses)

    with pytest.raises(InputError, match=r"same recording") as refusal:
        evaluate_trajectory(other, TRUTH)
    assert len(str(refusal.value)) < 200


@pytest.mark.parametrize("all_pairs", [True, False])
def test_without_poses_so_far_apart_it_is_an_input_error(all_pairs):
    with pytest.raises(InputError, match="no two of the 5 common poses are 50 m apart"):
        evaluate_trajectory(TRUTH, TRUTH, delta=50.0, all_pairs=all_pairs)


def test_one_common_pose_has_no_relative_error():
    one = Trajectory(STAMPS[:1], TRUTH.poses[:1])

    with pytest.raises(InputError, match="one pose in common"):
        evaluate_trajectory(one, TRUTH)


def test_converts_to_json():
    found = json.loads(json.dumps(evaluate_trajectory(noisy(3), TRUTH).to_dict()))

    assert list(found) == ["num_poses", "num_missing", "aligned", "alignment", "ate", "rpe"]
    assert found["num_poses"] == 5
    assert list(found["alignment"]) == ["x", "y", "theta_deg"]
    assert list(found["ate"]) == ["translation", "rotation_deg"]
    assert list(found["rpe"]) == ["delta", "delta_unit", "num_pairs", "translation", "rotation_deg"]


DENSE = Trajectory(
    np.arange(40.0),
    np.column_stack((0.2 * np.arange(40.0), np.sin(0.1 * np.arange(40.0)), 0.1 * np.arange(40.0))),
)
