# SPDX-License-Identifier: Apache-2.0
"""The maps to be judged: a simulated world, a seed and a fault each."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from bench.verdict.faults import FAULTS
from cartoloop.arrays import FloatArray
from cartoloop.evaluation.trajectories import align
from cartoloop.mapper import Mapper
from cartoloop.quality.pairs import path_lengths
from cartoloop.result import Result
from cartoloop.sensor.pose import compose_all, relative_all
from cartoloop.simulation import make_world, simulate

GROSS_ERROR_M = 0.3
"""A map with a larger error is wrong [m]."""


@dataclass(frozen=True)
class Case:
    """A map to be made.

    Attributes
    ----------
    world : simulated.
    seed : of the world and of all noise.
    fault : name in :data:`FAULTS`.
    """

    world: str
    seed: int
    fault: str

    @property
    def name(self) -> str:
        """One word for files."""
        return f"{self.world}-{self.seed}-{self.fault.replace(', ', '+').replace(' ', '-')}"


@dataclass(frozen=True)
class Truth:
    """How far a map is from the truth.

    Attributes
    ----------
    mean, largest : error of the positions of the scans, the map aligned as a rigid whole [m].
    revisits : error of the relative positions of nodes of different visits of a place, which nine
        in ten do not exceed [m]; 0 where no place was visited twice.
    """

    mean: float
    largest: float
    revisits: float

    @property
    def error(self) -> float:
        """The larger of the error in the mean and that between visits of a place [m]."""
        return max(self.mean, self.revisits)

    @property
    def is_wrong(self) -> bool:
        """Whether there is a gross error."""
        return self.error > GROSS_ERROR_M


def make_map(case: Case) -> tuple[Result, Truth]:
    """Return the map of a case, and how wrong it is."""
    fault = FAULTS[case.fault]
    world = make_world(case.world, case.seed)
    recording = simulate(
        world,
        odometry=fault.odometry,
        seed=case.seed,
        with_odometry=False if fault.without_odometry else None,
    )
    rng = np.random.default_rng([case.seed, zlib.crc32(case.fault.encode())])
    events = list(recording.events())
    if fault.change is not None:
        events = fault.change(events, rng)
    mapper = Mapper(fault.config())
    for event in events:
        mapper.add(event)
    result = mapper.finish()
    return result, truth_of(result, recording.stamps, recording.true_poses)


def truth_of(result: Result, stamps: FloatArray, poses: FloatArray) -> Truth:
    """Return the error of a map's trajectory.

    Parameters
    ----------
    result : its stamps occur among `stamps`.
    stamps : float64 (n,), increasing [s].
    poses : float64 (n, 3), true ones [m, m, rad].
    """
    rows = np.clip(np.searchsorted(stamps, result.stamps - 1e-4), 0, len(stamps) - 1)
    truth, estimate = poses[rows], result.trajectory
    moved = compose_all(np.array(align(estimate[:, :2], truth[:, :2])), estimate)
    errors = np.hypot(*(moved[:, :2] - truth[:, :2]).T)
    nodes = result.node_scan_index
    return Truth(
        float(errors.mean()), float(errors.max()), _revisit_error(estimate[nodes], truth[nodes])
    )


REVISIT_M, BETWEEN_M, STRIDE = 3.0, 8.0, 4
"""Nodes so near to each other [m] with so long a path between them are of different visits; one
node in four is looked at."""


def _revisit_error(estimate: FloatArray, truth: FloatArray) -> float:
    """Return the 90% quantile of the errors between visits [m]."""
    paths = path_lengths(truth)
    rows, errors = np.arange(0, len(truth), STRIDE), []
    for row in rows.tolist():
        is_near = np.linalg.norm(truth[rows, :2] - truth[row, :2], axis=1) < REVISIT_M
        others = rows[is_near & (paths[rows] - paths[row] > BETWEEN_M)]
        if len(others):
            wrong = relative_all(estimate[row], estimate[others])
            wrong -= relative_all(truth[row], truth[others])
            errors.append(np.linalg.norm(wrong[:, :2], axis=1))
    return float(np.quantile(np.concatenate(errors), 0.9)) if errors else 0.0
