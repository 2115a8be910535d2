# SPDX-License-Identifier: Apache-2.0
"""Error of a trajectory against the true one: ATE and RPE.

Both are the metrics of Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems" (2012),
in the plane, and the numbers of the tool evo on the same files:

==============================================  ==================================================
ours                                            evo's options after ``tum TRUTH ESTIMATE``
==============================================  ==================================================
absolute, translation                           ``evo_ape -a``
absolute, rotation                              ``evo_ape -a -r angle_deg``
absolute, ``aligned=False``                     ``evo_ape`` without ``-a``
relative, translation                           ``evo_rpe -d DELTA -u m --all_pairs``
relative, rotation                              ``evo_rpe -d DELTA -u m --all_pairs -r angle_deg``
relative, ``delta_unit="frames"``               ``evo_rpe -d DELTA -u f --all_pairs``
relative, ``all_pairs=False``                   ``evo_rpe`` without ``--all_pairs``
relative, ``pairs_from="truth"``                ``evo_rpe --pairs_from_reference``
``max_difference``                              ``--t_max_diff``
==============================================  ==================================================

Spans of seconds (``delta_unit="s"``) evo does not have. Where a stamp occurs more than once in the
longer trajectory, its first pose counts here, in evo sometimes the last.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import InputError
from cartoloop.evaluation.error_statistics import ErrorStatistics
from cartoloop.evaluation.pose_pairs import frame_pairs, span_pairs
from cartoloop.evaluation.trajectories import Trajectory, align
from cartoloop.sensor.pose import IDENTITY, Pose, compose_all, relative_all, wrap_angles
from cartoloop.sensor.time_repair import LATEST_STAMP

DeltaUnit = Literal["m", "s", "frames"]
PairsFrom = Literal["estimate", "truth"]

DEFAULT_MAX_DIFFERENCE_S = 0.01
"""Stamps at most so far apart are of the same moment."""


@dataclass(frozen=True)
class MatchedPoses:
    """Estimated and true poses of the same moments.

    Attributes
    ----------
    stamps : float64 (n,) [s], those of the trajectory that has fewer poses, in its order.
    estimate, truth : float64 (n, 3), x [m], y [m], theta [rad], each in its own frame.
    num_missing : poses of the trajectory that has fewer, without one of the same moment in the
        other.
    """

    stamps: FloatArray
    estimate: FloatArray
    truth: FloatArray
    num_missing: int = 0


@dataclass(frozen=True)
class PoseErrors:
    """Errors one by one.

    Attributes
    ----------
    stamps : float64 (n,) [s]; of the later pose, where the error is one of a pair.
    translation : float64 (n,), distances [m].
    rotation_deg : float64 (n,), absolute angles [deg].
    """

    stamps: FloatArray
    translation: FloatArray
    rotation_deg: FloatArray

    def to_dict(self) -> dict[str, dict[str, float]]:
        """Return the statistics of both, as for JSON."""
        return {
            "translation": ErrorStatistics.of(self.translation).to_dict(),
            "rotation_deg": ErrorStatistics.of(self.rotation_deg).to_dict(),
        }


@dataclass(frozen=True)
class TrajectoryError:
    """How far an estimate is from the truth.

    Attributes
    ----------
    matched : what was compared; the estimate lies as it was judged, aligned or not.
    tf_truth_estimate : what the estimate was moved by.
    aligned : whether it was moved.
    absolute : error of each pose.
    relative : error of each pair of poses.
    delta, delta_unit : how far apart the poses of a pair are.
    """

    matched: MatchedPoses
    tf_truth_estimate: Pose
    aligned: bool
    absolute: PoseErrors
    relative: PoseErrors
    delta: float
    delta_unit: DeltaUnit

    def to_dict(self) -> dict[str, Any]:
        """Return plain dictionaries and numbers, as for JSON."""
        x, y, theta = self.tf_truth_estimate
        return {
            "num_poses": len(self.matched.stamps),
            "num_missing": self.matched.num_missing,
            "aligned": self.aligned,
            "alignment": {"x": x, "y": y, "theta_deg": float(np.degrees(theta))},
            "ate": self.absolute.to_dict(),
            "rpe": {
                "delta": self.delta,
                "delta_unit": self.delta_unit,
                "num_pairs": len(self.relative.stamps),
                **self.relative.to_dict(),
            },
        }


def evaluate_trajectory(
    estimate: Trajectory,
    truth: Trajectory,
    *,
    aligned: bool = True,
    delta: float = 1.0,
    delta_unit: DeltaUnit = "m",
    all_pairs: bool = True,
    pairs_from: PairsFrom = "estimate",
    max_difference: float = DEFAULT_MAX_DIFFERENCE_S,
) -> TrajectoryError:
    """Return the absolute and the relative error of an estimated trajectory.

    Parameters
    ----------
    estimate, truth : what to judge, and by what; their frames may differ.
    aligned : whether the estimate is first brought to the truth as a rigid whole.
    delta, delta_unit, all_pairs, pairs_from : see :func:`relative_error`.
    max_difference : see :func:`match`.

    Raises
    ------
    ConfigError
        `delta` or `max_difference` is impossible.
    InputError
        The trajectories have no moment in common, or no two poses are `delta` apart.
    """
    matched = match(estimate, truth, max_difference)
    tf_truth_estimate = IDENTITY
    if aligned:
        tf_truth_estimate = align(matched.estimate[:, :2], matched.truth[:, :2])
        moved = compose_all(np.array(tf_truth_estimate), matched.estimate)
        matched = replace(matched, estimate=moved)
    return TrajectoryError(
        matched=matched,
        tf_truth_estimate=tf_truth_estimate,
        aligned=aligned,
        absolute=absolute_error(matched),
        relative=relative_error(
            matched, delta, delta_unit, all_pairs=all_pairs, pairs_from=pairs_from
        ),
        delta=delta,
        delta_unit=delta_unit,
    )


def match(
    estimate: Trajectory, truth: Trajectory, max_difference: float = DEFAULT_MAX_DIFFERENCE_S
) -> MatchedPoses:
    """Return the poses of common moments: the nearest in time to each pose of the shorter.

    Parameters
    ----------
    estimate, truth : stamps may be in any order, be missing, or occur more than once.
    max_difference : of stamps that are of the same moment [s]. What is further off is left out.

    Raises
    ------
    ConfigError
        `max_difference` is negative or no number.
    InputError
        There is no such pair of poses.
    """
    longer, shorter = truth, estimate
    if len(estimate.stamps) > len(truth.stamps):
        longer, shorter = estimate, truth
    rows = longer.find(shorter.stamps, max_difference)
    found = rows >= 0
    if not np.any(found):
        raise InputError(
            f"no pose of the estimate ({_time_span(estimate)}) is within {max_difference:g} s of a "
            f"pose of the truth ({_time_span(truth)}): of the same recording?"
        )
    of_shorter, of_longer = shorter.poses[found], longer.poses[rows[found]]
    swapped = shorter is truth
    return MatchedPoses(
        stamps=shorter.stamps[found],
        estimate=of_longer if swapped else of_shorter,
        truth=of_shorter if swapped else of_longer,
        num_missing=int(np.count_nonzero(~found)),
    )


def absolute_error(matched: MatchedPoses) -> PoseErrors:
    """Return how far each estimated pose is from the true one, as they lie."""
    difference = matched.estimate - matched.truth
    return PoseErrors(
        stamps=matched.stamps,
        translation=np.hypot(difference[:, 0], difference[:, 1]),
        rotation_deg=np.abs(np.degrees(wrap_angles(difference[:, 2]))),
    )


def relative_error(
    matched: MatchedPoses,
    delta: float = 1.0,
    delta_unit: DeltaUnit = "m",
    *,
    all_pairs: bool = True,
    pairs_from: PairsFrom = "estimate",
) -> PoseErrors:
    """Return how far each estimated motion over a span is from the true motion.

    Parameters
    ----------
    matched : what to compare.
    delta, delta_unit : length of a span: metres of path, seconds, or a whole number of poses.
    all_pairs : whether a span starts at every pose; otherwise each starts where the last ended.
    pairs_from : whose path the metres are measured along.

    Raises
    ------
    ConfigError
        `delta` is impossible.
    InputError
        No two poses are so far apart.

    Notes
    -----
    With `all_pairs` a span ends at the pose that comes nearest to `delta`, and counts if that is
    within a tenth of it. Otherwise it ends at the first pose that is at least `delta` away.

    The error is the motion that leads from the true motion to the estimated one: its length and
    the size of its angle. No alignment changes it. O(n log n).
    """
    poses = matched.estimate if pairs_from == "estimate" else matched.truth
    if len(poses) < 2:
        raise InputError("the trajectories have one pose in common: errors of motion need two")
    order = np.arange(len(poses))
    if delta_unit == "frames":
        first, second = frame_pairs(len(poses), delta, all_pairs)
    elif delta_unit == "s":
        order = np.argsort(matched.stamps, kind="stable")  # recorded stamps may run backwards
        first, second = span_pairs(matched.stamps[order], delta, all_pairs)
    else:
        steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        first, second = span_pairs(np.concatenate(([0.0], np.cumsum(steps))), delta, all_pairs)
    if len(first) == 0:
        raise InputError(
            f"no two of the {len(poses)} common poses are {delta:g} {delta_unit} apart: "
            "choose another delta"
        )
    first, second = order[first], order[second]
    true_motion = relative_all(matched.truth[first], matched.truth[second])
    estimated_motion = relative_all(matched.estimate[first], matched.estimate[second])
    error = relative_all(true_motion, estimated_motion)
    return PoseErrors(
        stamps=matched.stamps[second],
        translation=np.hypot(error[:, 0], error[:, 1]),
        rotation_deg=np.abs(np.degrees(error[:, 2])),
    )


def _time_span(trajectory: Trajectory) -> str:
    if len(trajectory.stamps) == 0:
        return "no poses"
    first, last = (
        f"{stamp:.3f}" if abs(stamp) <= LATEST_STAMP else f"{stamp:g}"
        for stamp in (trajectory.stamps.min(), trajectory.stamps.max())
    )
    return f"{first} to {last} s"
