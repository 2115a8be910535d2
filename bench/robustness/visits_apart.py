# SPDX-License-Identifier: Apache-2.0
"""How far apart walls stand that were seen at different times: a measure that needs no truth.

Run: ``python -m bench.robustness.visits_apart LOG TRAJECTORY...``, trajectories in TUM format.

Scans are put together by the poses of a trajectory. Around some returns, those of other visits are
compared with those of the same visit, along the normal of the wall: a bent or doubled map sets them
apart. The mean entropy of the neighbourhoods (Droeschel, Behnke: Efficient Continuous-time SLAM for
3D Lidar-based Online Mapping, ICRA 2018) is larger where walls are thick, for whatever reason.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from cartoloop.arrays import FloatArray
from cartoloop.errors import CartoloopError, InputError
from cartoloop.evaluation.trajectories import Trajectory, read_tum
from cartoloop.readers import open_log
from cartoloop.sensor.events import LaserScan
from cartoloop.sensor.pose import Pose, transform_points

STEP_M, STEP_RAD = 0.5, 0.35
"""Motion after which a scan is taken [m], [rad]."""

REACH_M = 12.0
"""Farther returns are left out [m]: they lie farther apart than walls are thick."""

RADIUS_M, MIN_OTHER, MIN_OWN = 0.3, 8, 5
"""Neighbourhood of a return [m], and number of returns of other visits and of its own in it."""

OTHER_VISIT_S = 60.0
"""Returns this much earlier or later are of another visit [s]."""

SAMPLES = 20_000
"""Returns whose neighbourhoods are examined."""

SAME_STAMP_S = 0.005
"""A pose with a stamp this near that of a scan is its pose [s]."""


class Agreement(NamedTuple):
    """How well the visits of a map agree.

    Attributes
    ----------
    mean, median, most : distance of walls of different visits: mean, median, 90th percentile [m].
    entropy : mean of the neighbourhoods, in nats.
    places : number of the neighbourhoods compared.
    """

    mean: float
    median: float
    most: float
    entropy: float
    places: int


def agreement(points: FloatArray, stamps: FloatArray) -> Agreement:
    """Return how well the visits of a map agree.

    Parameters
    ----------
    points : float64, shape (n, 2), returns, map frame [m].
    stamps : float64, shape (n,), of their scans [s].

    Raises
    ------
    InputError
        No place was seen twice.
    """
    tree = cKDTree(points)
    chosen = np.random.default_rng(0).permutation(len(points))[:SAMPLES]
    apart, entropies = [], []
    for row, near in zip(
        chosen.tolist(), tree.query_ball_point(points[chosen], RADIUS_M), strict=True
    ):
        rows = np.array(near)
        is_other = np.abs(stamps[rows] - stamps[row]) > OTHER_VISIT_S
        if is_other.sum() < MIN_OTHER or (~is_other).sum() < MIN_OWN:
            continue
        variances, axes = np.linalg.eigh(np.cov(points[rows].T))
        across = points[rows] @ axes[:, 0]
        apart.append(abs(np.median(across[is_other]) - np.median(across[~is_other])))
        spread = max(float(np.prod(variances)), 1e-12)
        entropies.append(math.log(2.0 * math.pi * math.e) + 0.5 * math.log(spread))
    if not apart:
        raise InputError("no place was seen twice: nothing can be compared")
    return Agreement(
        float(np.mean(apart)),
        float(np.median(apart)),
        float(np.quantile(apart, 0.9)),
        float(np.mean(entropies)),
        len(apart),
    )


def map_points(scans: list[LaserScan], trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Return the returns of scans at the poses of a trajectory, and the stamps of their scans.

    Of scans at nearly the same pose, the first is taken.

    Raises
    ------
    InputError
        The trajectory has a pose for none of them.
    """
    rows = trajectory.find(np.array([scan.stamp for scan in scans]), SAME_STAMP_S)
    groups, times = [], []
    last: Pose | None = None
    for scan, row in zip(scans, rows.tolist(), strict=True):
        if row < 0:
            continue
        pose = Pose(*trajectory.poses[row].tolist())
        if last is not None and _is_near(last, pose):
            continue
        last = pose
        returns = _returns(scan)
        groups.append(transform_points(pose, returns))
        times.append(np.full(len(returns), scan.stamp))
    if not groups:
        raise InputError("the trajectory has a pose for none of the scans: is it of this log?")
    return np.concatenate(groups), np.concatenate(times)


def _is_near(one: Pose, other: Pose) -> bool:
    turn = abs(math.remainder(other.theta - one.theta, math.tau))
    return math.hypot(other.x - one.x, other.y - one.y) < STEP_M and turn < STEP_RAD


def _returns(scan: LaserScan) -> FloatArray:
    """Return the returns of a scan, tracking frame [m]."""
    geometry = scan.geometry
    is_return = (scan.ranges > geometry.range_min) & (scan.ranges < REACH_M)
    ranges, angles = scan.ranges[is_return], geometry.angles[is_return]
    points = np.stack((ranges * np.cos(angles), ranges * np.sin(angles)), axis=1)
    return transform_points(geometry.tf_tracking_sensor, points)


def main(arguments: list[str]) -> int:
    """Print the agreement of each trajectory; return the exit status."""
    if len(arguments) < 2:
        sys.stderr.write("usage: python -m bench.robustness.visits_apart LOG TRAJECTORY...\n")
        return 2
    try:
        scans = [event for event in open_log(Path(arguments[0])) if isinstance(event, LaserScan)]
        for name in arguments[1:]:
            found = agreement(*map_points(scans, read_tum(Path(name))))
            sys.stdout.write(
                f"{name}: walls of different visits {1e3 * found.mean:.1f} mm apart "
                f"(median {1e3 * found.median:.1f}, 90% within {1e3 * found.most:.1f}), "
                f"entropy {found.entropy:.3f}, {found.places} places\n"
            )
    except CartoloopError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
