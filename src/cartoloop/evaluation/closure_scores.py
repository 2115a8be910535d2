# SPDX-License-Identifier: Apache-2.0
"""How many loop closures there are, and how many of them are right: table IV of the paper.

The paper judges a closure by the map that it helped to make. Where the truth is known, closures
are judged by it as well, and those that could have been are counted.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import Config
from cartoloop.errors import InputError
from cartoloop.evaluation.finished_run import FinishedRun, Stage, StageClosures
from cartoloop.evaluation.overlap import MIN_SHARE, closable_pairs, place_scans
from cartoloop.evaluation.trajectories import Trajectory
from cartoloop.global_slam.pose_graph import TRUE_ROTATION_RAD, TRUE_TRANSLATION_M
from cartoloop.readers.log import Log
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles

TOLERANCE_S = 5e-3
"""Stamps of true poses are those of scans up to rounding."""


@dataclass(frozen=True)
class Recall:
    """Which of the loop closures that could have been there are.

    Attributes
    ----------
    pairs : pairs of submap and node that show the same, see :mod:`cartoloop.evaluation.overlap`.
    pairs_closed : those of them with a true closure.
    revisits : pairs of submap and submap of the node among these pairs: the mapper does not search
        every node, but every revisit should be noticed.
    revisits_closed : those of them with at least one true closure.
    """

    pairs: int
    pairs_closed: int
    revisits: int
    revisits_closed: int

    @property
    def of_pairs(self) -> float | None:
        """Share of the pairs that are closed, None if there are none."""
        return _share(self.pairs_closed, self.pairs)

    @property
    def of_revisits(self) -> float | None:
        """Share of the revisits that are closed, None if there are none."""
        return _share(self.revisits_closed, self.revisits)


@dataclass(frozen=True)
class StageScore:
    """One row of table IV.

    Attributes
    ----------
    constraints : loop closures.
    agreeing : those of them violated by no more than 20 cm and 1 degree at the solution of (SPA).
    rejected : further ones, taken out of the graph because the rest contradicted them.
    true : closures whose measured pose is within 20 cm and 1 degree of the truth, None if that is
        not known.
    true_rejected : the same of those rejected, None also where none can be.
    recall : None if the truth or the recording is not known.
    """

    constraints: int
    agreeing: int
    rejected: int = 0
    true: int | None = None
    true_rejected: int | None = None
    recall: Recall | None = None

    @property
    def precision(self) -> float | None:
        """Share that agrees with the poses, those rejected counted as wrong, as in the report."""
        return _share(self.agreeing, self.constraints + self.rejected)

    @property
    def true_precision(self) -> float | None:
        """Share of the constraints that is true; None if the truth is not known, or without any."""
        return None if self.true is None else _share(self.true, self.constraints)

    def to_dict(self) -> dict[str, Any]:
        """Return plain dictionaries and numbers, as for JSON."""
        values = asdict(self) | {
            "precision": self.precision,
            "true_precision": self.true_precision,
        }
        if self.recall is not None:
            values["recall"] |= {
                "of_pairs": self.recall.of_pairs,
                "of_revisits": self.recall.of_revisits,
            }
        return values


@dataclass(frozen=True)
class ClosuresScore:
    """Table IV of one run: closures in the finished graph, and those found while mapping."""

    final: StageScore
    found: StageScore

    def to_dict(self) -> dict[str, Any]:
        """Return plain dictionaries and numbers, as for JSON."""
        return {"final": self.final.to_dict(), "found": self.found.to_dict()}


def evaluate_closures(
    run: FinishedRun,
    truth: Trajectory | None = None,
    log: Log | None = None,
    config: Config | None = None,
    min_share: float = MIN_SHARE,
) -> ClosuresScore:
    """Return the precision of a run's loop closures and, where the truth is known, their recall.

    Parameters
    ----------
    run : what was mapped.
    truth : the true pose of each scan; without it only the paper's figures are given.
    log : the recording that was mapped; without it no recall is given.
    config : with which it was mapped, None for the defaults; its voxel filter is that of recall.
    min_share : of a node's points that a submap must have seen as well, for recall, in (0, 1].

    Raises
    ------
    InputError
        The truth lacks a node's scan, or the recording does.
    ValueError
        There is a recording, but no truth.
    """
    if log is not None and truth is None:
        raise ValueError("recall needs the truth as well as the recording")
    final, found = run.closures[Stage.FINAL], run.closures[Stage.FOUND]
    rejected = run.closures[Stage.REJECTED]
    if truth is None:
        return ClosuresScore(_agreement(final, len(rejected)), _agreement(found))
    true_nodes = true_node_poses(run, truth)
    true_submaps = true_submap_poses(run, true_nodes)
    pairs = None
    if log is not None:
        pairs = _closable_pairs(run, true_nodes, log, config or Config(), min_share)

    def judged(closures: StageClosures, num_rejected: int = 0) -> StageScore:
        true = is_true(closures, true_submaps, true_nodes)
        return replace(
            _agreement(closures, num_rejected),
            true=_count(true),
            recall=None if pairs is None else recall(run, closures, true, pairs),
        )

    true_rejected = _count(is_true(rejected, true_submaps, true_nodes))
    return ClosuresScore(
        replace(judged(final, len(rejected)), true_rejected=true_rejected), judged(found)
    )


def _agreement(closures: StageClosures, rejected: int = 0) -> StageScore:
    """Return what can be said without the truth."""
    agreeing = is_within(closures.residual_m, np.radians(closures.residual_deg))
    return StageScore(len(closures), _count(agreeing), rejected)


def _closable_pairs(
    run: FinishedRun, true_nodes: FloatArray, log: Log, config: Config, min_share: float
) -> IntArray:
    return closable_pairs(
        place_scans(log, run.stamps, true_nodes, config, log.name),
        run.own_submap,
        run.own_node,
        run.num_submaps,
        config.global_slam.constraint_search.min_num_points,
        min_share,
    )


def is_within(translation_error: FloatArray, rotation_error: FloatArray) -> BoolArray:
    """Return where errors [m], [rad] are no more than 20 cm and 1 degree (table IV)."""
    within: BoolArray = (translation_error <= TRUE_TRANSLATION_M) & (
        rotation_error <= TRUE_ROTATION_RAD
    )
    return within


def is_true(closures: StageClosures, true_submaps: FloatArray, true_nodes: FloatArray) -> BoolArray:
    """Return which closures' measured poses are within 20 cm and 1 degree of the truth.

    Parameters
    ----------
    closures : to judge.
    true_submaps, true_nodes : true poses, shapes (s, 3), (n, 3) [m, m, rad].
    """
    error = closures.tf_submap_node - relative_all(
        true_submaps[closures.submap], true_nodes[closures.node]
    )
    return is_within(np.hypot(error[:, 0], error[:, 1]), np.abs(wrap_angles(error[:, 2])))


def true_node_poses(run: FinishedRun, truth: Trajectory) -> FloatArray:
    """Return the true pose of each node, shape (n, 3) [m, m, rad].

    Raises
    ------
    InputError
        A node's scan is not in the truth.
    """
    rows = truth.find(run.stamps, TOLERANCE_S)
    missing = run.stamps[rows < 0]
    if len(missing):
        raise InputError(
            f"{run.folder}: the truth has no pose for {len(missing)} of {run.num_nodes} nodes, "
            f"first at stamp {missing[0]:.6f}: give the truth of the recording that was mapped"
        )
    return truth.poses[rows]


def true_submap_poses(run: FinishedRun, true_nodes: FloatArray) -> FloatArray:
    """Return where each submap truly stands, shape (s, 3) [m, m, rad].

    A submap is known through its own scans alone: where each of them truly stood and where in the
    submap it was inserted gives a pose of the submap; the median of these counts.
    """
    x, y, theta = run.own_pose.T
    cos, sin = np.cos(theta), np.sin(theta)
    tf_node_submap = np.column_stack((-cos * x - sin * y, sin * x - cos * y, -theta))
    estimates = compose_all(true_nodes[run.own_node], tf_node_submap)
    poses = np.full((run.num_submaps, 3), np.nan)
    for submap in np.unique(run.own_submap).tolist():
        own = estimates[run.own_submap == submap]
        # angles about one of them: the median does not mind which, the turn at pi does
        turns = wrap_angles(own[:, 2] - own[0, 2])
        poses[submap, :2] = np.median(own[:, :2], axis=0)
        poses[submap, 2] = wrap_angles(own[0, 2] + np.median(turns))
    return poses


def recall(run: FinishedRun, closures: StageClosures, true: BoolArray, pairs: IntArray) -> Recall:
    """Return how many of the pairs (submap, node), shape (k, 2), have a true closure.

    Parameters
    ----------
    run : whose closures they are.
    closures : that were made.
    true : which of them are true, shape (len(closures),).
    pairs : that could have been closed.
    """
    own = run.first_submap()
    closed = np.column_stack((closures.submap[true], closures.node[true]))
    revisits = np.unique(np.column_stack((pairs[:, 0], own[pairs[:, 1]])), axis=0)
    noticed = np.column_stack((closed[:, 0], own[closed[:, 1]]))
    return Recall(
        pairs=len(pairs),
        pairs_closed=_count(_among(pairs, closed, run.num_nodes)),
        revisits=len(revisits),
        revisits_closed=_count(_among(revisits, noticed, run.num_nodes)),
    )


def _among(pairs: IntArray, others: IntArray, base: int) -> BoolArray:
    """Return which pairs (k, 2) are among others; the second of each is less than `base`."""
    found: BoolArray = np.isin(pairs[:, 0] * base + pairs[:, 1], others[:, 0] * base + others[:, 1])
    return found


def _count(mask: BoolArray) -> int:
    return int(np.count_nonzero(mask))


def _share(part: int, total: int) -> float | None:
    return part / total if total else None
