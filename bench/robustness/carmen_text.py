# SPDX-License-Identifier: Apache-2.0
"""CARMEN logs as rows that can be changed and written again: scans, odometry, other lines."""

from __future__ import annotations

import gzip
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.errors import InputError

POSE = 3
"""Numbers in a pose: x, y [m], theta [rad]."""

STAMPS = 3
"""Number of words at the end of each line: time stamp, host and logger's time stamp."""


@dataclass(slots=True)
class CarmenText:
    """The readings of a log, in the order of its file.

    Attributes
    ----------
    comments : lines that are no reading, which stand first when it is written.
    poses : float64, shape (n, 3), odometry poses of all readings, x [m], y [m], theta [rad].
    ranges : for each reading the ranges of its scan [m], None for odometry alone.
    tails : for each reading its stamp, host and logger's time, or whatever stands behind the poses.
    angles : first angle and step [rad] of the beams, where readers could not infer them from
        their number.
    """

    comments: list[str]
    poses: FloatArray
    ranges: list[FloatArray | None]
    tails: list[list[str]]
    angles: tuple[float, float] | None = None

    @property
    def times(self) -> FloatArray:
        """Times of the readings [s], shape (n,): their stamps, never running backwards."""
        stamps = np.array([float(tail[-3]) for tail in self.tails])
        times: FloatArray = np.maximum.accumulate(stamps)
        return times

    @property
    def is_scan(self) -> BoolArray:
        """Which readings have a scan, shape (n,)."""
        return np.array([ranges is not None for ranges in self.ranges])

    @property
    def num_beams(self) -> int:
        """Number of ranges in the first scan."""
        return next(len(ranges) for ranges in self.ranges if ranges is not None)

    @property
    def no_return(self) -> float:
        """The largest range of all [m], which stands for a beam without a return."""
        return max(float(ranges.max()) for ranges in self.ranges if ranges is not None)

    def keep(self, kept: BoolArray) -> None:
        """Drop all readings but those that are kept, shape (n,)."""
        self.poses = self.poses[kept]
        chosen = np.flatnonzero(kept).tolist()
        self.ranges = [self.ranges[row] for row in chosen]
        self.tails = [self.tails[row] for row in chosen]


def read_carmen(path: Path) -> CarmenText:
    """Return the FLASER and ODOM lines of a log, which may be compressed.

    Raises
    ------
    InputError
        It cannot be read, or has no scan.
    """
    comments: list[str] = []
    poses: list[list[float]] = []
    ranges: list[FloatArray | None] = []
    tails: list[list[str]] = []
    try:
        data = path.read_bytes()
        text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8", "replace")
        for number, line in enumerate(text.splitlines(), 1):
            words = line.split()
            if words[:1] == ["ODOM"]:
                poses.append([float(word) for word in words[1 : 1 + POSE]])
                ranges.append(None)
                tails.append(words[1 + POSE :])
            elif words[:1] == ["FLASER"]:
                end = 2 + int(words[1])
                ranges.append(np.array(words[2:end], dtype=np.float64))
                poses.append([float(word) for word in words[end + POSE : end + 2 * POSE]])
                tails.append(words[end + 2 * POSE :])
            elif words:
                comments.append(line)
            if poses and (len(poses[-1]) < POSE or len(tails[-1]) < STAMPS):
                raise ValueError(f"line {number} ends early")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be changed: {error}") from error
    if not any(scan is not None for scan in ranges):
        raise InputError(f"{path}: has no FLASER lines to change")
    return CarmenText(comments, np.array(poses), ranges, tails)


def write_carmen(path: Path, log: CarmenText) -> None:
    """Write a log: poses with six decimals, ranges with up to three."""
    with path.open("w", encoding="ascii", errors="replace") as file:
        file.writelines(f"{line}\n" for line in log.comments)
        for pose, ranges, tail in zip(log.poses.tolist(), log.ranges, log.tails, strict=True):
            place = " ".join(f"{value:.6f}" for value in pose)
            behind = " ".join(tail)
            if ranges is None:
                file.write(f"ODOM {place} {behind}\n")
            else:
                shown = " ".join(map(_range_text, ranges.tolist()))
                file.write(f"{_head(log, len(ranges))} {shown} {_poses(log, place)} {behind}\n")


def _head(log: CarmenText, count: int) -> str:
    if log.angles is None:
        return f"FLASER {count}"
    first, step = log.angles
    return f"ROBOTLASER1 0 {first:.9f} {step * (count - 1):.9f} {step:.9f} 0 0 0 {count}"


def _poses(log: CarmenText, place: str) -> str:
    """Return the poses behind the ranges: of the laser and of the robot, which are the same."""
    return f"{place} {place}" if log.angles is None else f"0 {place} {place} 0 0 0 0 0"


def _range_text(value: float) -> str:
    return f"{value:.2f}" if value == math.floor(value) else f"{value:.3f}".rstrip("0")
