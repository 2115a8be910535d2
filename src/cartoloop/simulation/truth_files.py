# SPDX-License-Identifier: Apache-2.0
"""Ground truth of simulated recordings as files: poses, relations, tape lines."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.sensor.pose import relative_all
from cartoloop.simulation.text_writer import write_text

NEIGHBOUR_PATH_M = (0.3, 3.0)
"""Path length between neighbours of a relation [m]: consecutive, but not the same place."""

LOOP_PATH_M = 20.0
"""Path length from which on two scans of one place are on different passes [m]."""

LOOP_DISTANCE_M = 2.0
"""Largest distance between two scans of one place [m]."""


def write_truth(path: Path, stamps: FloatArray, true_poses: FloatArray) -> None:
    """Write the true poses as a TUM trajectory: ``stamp tx ty tz qx qy qz qw`` for each scan.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    rows = zip(stamps.tolist(), true_poses.tolist(), strict=True)
    write_text(
        path,
        (
            (
                f"{stamp:.6f} {x:.9f} {y:.9f} 0 0 0 "
                f"{math.sin(theta / 2):.9f} {math.cos(theta / 2):.9f}\n"
            ).encode("ascii")
            for stamp, (x, y, theta) in rows
        ),
    )


def write_relations(
    path: Path, stamps: FloatArray, true_poses: FloatArray, num_relations: int, seed: int
) -> None:
    """Write true relations, ``stamp1 stamp2 x y z roll pitch yaw``: the pose of 2 as seen from 1.

    Half of them connect neighbours, half connect scans of one place on different passes, where
    such passes exist.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    pairs = relation_pairs(true_poses, num_relations, seed)
    steps = relative_all(true_poses[pairs[:, 0]], true_poses[pairs[:, 1]])
    write_text(
        path,
        (
            f"{stamp_1:.6f} {stamp_2:.6f} {x:.9f} {y:.9f} 0 0 0 {theta:.9f}\n".encode("ascii")
            for (stamp_1, stamp_2), (x, y, theta) in zip(
                stamps[pairs].tolist(), steps.tolist(), strict=True
            )
        ),
    )


def write_tape_lines(path: Path, lines: FloatArray, first_pose: FloatArray) -> None:
    """Write tape lines, ``x1 y1 x2 y2 length`` [m] each, in the frame of a mapper's map.

    The origin of that map is the first scan.

    Parameters
    ----------
    path : of the file.
    lines : float64, shape (num_lines, 4), ends x1, y1, x2, y2 [m], map frame of the world.
    first_pose : float64, shape (3,), true pose of the first scan [m, rad], map frame of the world.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    ends = np.column_stack((lines.reshape(-1, 2), np.zeros(2 * len(lines))))
    seen = relative_all(first_pose, ends)[:, :2].reshape(-1, 4)
    lengths = np.hypot(seen[:, 2] - seen[:, 0], seen[:, 3] - seen[:, 1])
    write_text(
        path,
        (
            f"{x1:.6f} {y1:.6f} {x2:.6f} {y2:.6f} {length:.6f}\n".encode("ascii")
            for (x1, y1, x2, y2), length in zip(seen.tolist(), lengths.tolist(), strict=True)
        ),
    )


def relation_pairs(true_poses: FloatArray, num_relations: int, seed: int = 0) -> IntArray:
    """Return the pairs of scans of relations, the earlier scan first, sorted, int64, shape (m, 2).

    Parameters
    ----------
    true_poses : float64, shape (n, 3), x [m], y [m], theta [rad], map frame.
    num_relations : number of pairs to draw; fewer where too few scans are near each other.
    seed : of the sample.
    """
    rng = np.random.default_rng(seed)
    steps = np.hypot(*np.diff(true_poses[:, :2], axis=0).T)
    travelled = np.concatenate(([0.0], np.cumsum(steps)))
    nearest, farthest = NEIGHBOUR_PATH_M
    neighbours: set[tuple[int, int]] = set()
    loops: set[tuple[int, int]] = set()
    for first in rng.permutation(len(true_poses)).tolist():
        ahead = travelled - travelled[first]
        apart = np.hypot(*(true_poses[:, :2] - true_poses[first, :2]).T)
        for wanted, pairs in (
            ((ahead >= nearest) & (ahead <= farthest), neighbours),
            ((ahead > LOOP_PATH_M) & (apart < LOOP_DISTANCE_M), loops),
        ):
            candidates = np.flatnonzero(wanted)
            if len(candidates) and len(pairs) < num_relations // 2:
                pairs.add((first, int(rng.choice(candidates))))
        if min(len(neighbours), len(loops)) >= num_relations // 2:
            break
    return np.array(sorted(neighbours | loops), dtype=np.int64).reshape(-1, 2)
