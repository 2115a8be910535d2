# SPDX-License-Identifier: Apache-2.0
"""The truth of simulated recordings as files, apart from the log: poses, relations, lines."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cartoloop.errors import ConfigError
from cartoloop.sensor.pose import relative_all
from cartoloop.simulation.text_writer import write_text

if TYPE_CHECKING:
    from cartoloop.simulation.recording import Recording
    from cartoloop.simulation.rig_recording import RigRecording

FloatArray = NDArray[np.float64]

# Relations: neighbours lie this far apart along the way; a loop pair is near again after a detour.
NEIGHBOUR_DISTANCE = (0.3, 3.0)
LOOP_DETOUR = 20.0
LOOP_DISTANCE = 2.0


def write_truth(recording: Recording | RigRecording, path: Path) -> None:
    """Write the true poses as a TUM trajectory: ``stamp tx ty tz qx qy qz qw`` for each scan.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    rows = zip(recording.stamps.tolist(), recording.true_poses.tolist(), strict=True)
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
    recording: Recording | RigRecording, path: Path, num_relations: int = 1000, seed: int = 0
) -> None:
    """Write true relations, ``stamp1 stamp2 x y z roll pitch yaw``: the pose of 2 as seen from 1.

    Half of them join neighbours, half join scans of one place on different passes, as far as
    there are such.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    pairs = relation_pairs(recording.true_poses, num_relations, seed)
    steps = relative_all(recording.true_poses[pairs[:, 0]], recording.true_poses[pairs[:, 1]])
    stamps = recording.stamps[pairs]
    write_text(
        path,
        (
            f"{stamp_1:.6f} {stamp_2:.6f} {x:.9f} {y:.9f} 0 0 0 {theta:.9f}\n".encode("ascii")
            for (stamp_1, stamp_2), (x, y, theta) in zip(
                stamps.tolist(), steps.tolist(), strict=True
            )
        ),
    )


def write_tape_lines(recording: Recording | RigRecording, path: Path) -> None:
    """Write the world's tape lines, ``x1 y1 x2 y2 length`` [m] each, as a mapper's map shows them.

    That map begins with the identity at the first scan, so the true first pose is the frame.

    Raises
    ------
    ConfigError
        When the world has no tape lines.
    OutputError
        When the file cannot be written.
    """
    lines = recording.tape_lines
    if len(lines) == 0:
        raise ConfigError(f"the simulated world {recording.name!r} has no tape lines: take 'flat'")
    ends = np.column_stack((lines.reshape(-1, 2), np.zeros(2 * len(lines))))
    seen = relative_all(recording.true_poses[0], ends)[:, :2].reshape(-1, 4)
    lengths = np.hypot(seen[:, 2] - seen[:, 0], seen[:, 3] - seen[:, 1])
    write_text(
        path,
        (
            f"{x1:.6f} {y1:.6f} {x2:.6f} {y2:.6f} {length:.6f}\n".encode("ascii")
            for (x1, y1, x2, y2), length in zip(seen.tolist(), lengths.tolist(), strict=True)
        ),
    )


def relation_pairs(true_poses: FloatArray, num_relations: int, seed: int = 0) -> NDArray[np.int64]:
    """Return the scans that relations join, earlier one first, sorted, int64, shape (m, 2).

    Parameters
    ----------
    true_poses : float64, shape (n, 3), x [m], y [m], theta [rad], map frame.
    num_relations : how many to draw; there are fewer where too few scans are near each other.
    seed : of the sample.
    """
    rng = np.random.default_rng(seed)
    steps = np.hypot(*np.diff(true_poses[:, :2], axis=0).T)
    travelled = np.concatenate(([0.0], np.cumsum(steps)))
    nearest, farthest = NEIGHBOUR_DISTANCE
    neighbours: set[tuple[int, int]] = set()
    loops: set[tuple[int, int]] = set()
    for first in rng.permutation(len(true_poses)).tolist():
        ahead = travelled - travelled[first]
        apart = np.hypot(*(true_poses[:, :2] - true_poses[first, :2]).T)
        for wanted, pairs in (
            ((ahead >= nearest) & (ahead <= farthest), neighbours),
            ((ahead > LOOP_DETOUR) & (apart < LOOP_DISTANCE), loops),
        ):
            candidates = np.flatnonzero(wanted)
            if len(candidates) and len(pairs) < num_relations // 2:
                pairs.add((first, int(rng.choice(candidates))))
        if min(len(neighbours), len(loops)) >= num_relations // 2:
            break
    return np.array(sorted(neighbours | loops), dtype=np.int64).reshape(-1, 2)
