# SPDX-License-Identifier: Apache-2.0
"""Odometry that stands still, jumps, repeats itself, slips, veers or is no number."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from enum import StrEnum

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.errors import ConfigError
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles


class OdometryFault(StrEnum):
    """What is wrong with the odometry."""

    FROZEN = "frozen"
    FROZEN_LATER = "frozen-later"
    JUMP = "jump"
    REPEAT = "repeat"
    NAN = "nan"
    SLIP = "slip"
    VEER = "veer"
    SYNCHRO = "synchro-drive"


NUM_SLIPS = 3
"""How often the wheels slip in a recording."""

SLIP_LENGTH = 6.0
"""Path length on which they do [m]."""

SLIP_FACTORS = (0.0, 0.5, 1.5, 2.5)
"""Measured over true path on slippery ground: in the first or in the second of these intervals,
for wheels that are dragged and wheels that spin."""

SLIP_TURN = np.radians(3.0)
"""Largest turn that odometry measures too much for each metre on slippery ground [rad/m]."""

VEER_RATES = (np.radians(1.0), np.radians(3.0))
"""Smallest and largest turn that odometry with a veer measures too much on each metre [rad/m], to
one side, or as the amplitude of a sine of its heading."""

NUM_JUMPS = 2
"""How often the odometry jumps."""

JUMP_LENGTHS = (1.0, 5.0)
"""Lengths of jumps [m]."""

JUMP_TURN = np.radians(60.0)
"""Largest turn of a jump [rad]."""

REPEATS = 10
"""Readings that follow one another without a change, where odometry repeats itself."""

SHARE_REPEATED = 0.2
"""Share of the recording in which it does."""

NAN_PART = (0.25, 0.75)
"""The part of the recording in which readings are no numbers."""


def fault_of(name: str) -> OdometryFault:
    """Return the fault of a name.

    Raises
    ------
    ConfigError
        There is none.
    """
    if name not in set(OdometryFault):
        nearest = get_close_matches(name, list(OdometryFault), n=1, cutoff=0.0)[0]
        raise ConfigError(
            f"no odometry fault {name!r}: choose from {', '.join(OdometryFault)} "
            f"(nearest: {nearest})"
        )
    return OdometryFault(name)


def with_faults(
    poses: FloatArray,
    path_lengths: FloatArray,
    faults: Sequence[OdometryFault],
    rng: np.random.Generator,
) -> FloatArray:
    """Return odometry with faults.

    Parameters
    ----------
    poses : float64, shape (n, 3), as measured without them, x [m], y [m], theta [rad].
    path_lengths : float64, shape (n,), true path length at each reading [m], increasing.
    faults : each at most once; applied in the order of :class:`OdometryFault`.
    rng : the source of where they happen.
    """
    found = poses.copy()
    count = len(poses)
    if OdometryFault.SLIP in faults:
        found = _slipping(found, path_lengths, rng)
    if OdometryFault.VEER in faults:
        found = _veering(found, rng.choice((-1.0, 1.0)) * rng.uniform(*VEER_RATES), 0.0, 0.0)
    if OdometryFault.SYNCHRO in faults:
        found = _veering(found, 0.0, rng.uniform(*VEER_RATES), rng.uniform(-np.pi, np.pi))
    if OdometryFault.JUMP in faults:
        found = _jumping(found, rng)
    if OdometryFault.REPEAT in faults:
        for begin in range(REPEATS, count - REPEATS, REPEATS):
            if rng.random() < SHARE_REPEATED:
                found[begin : begin + REPEATS] = found[begin]
    if OdometryFault.FROZEN_LATER in faults:
        found[count // 2 :] = found[count // 2]
    if OdometryFault.FROZEN in faults:
        found[:] = found[0]
    if OdometryFault.NAN in faults:
        begin, end = (round(share * count) for share in NAN_PART)
        found[begin:end] = np.nan
    return found


def slippery(path_lengths: FloatArray, rng: np.random.Generator) -> list[BoolArray]:
    """Return which readings are within each stretch on which the wheels slip, shape (n,) each."""
    length = float(path_lengths[-1] - path_lengths[0])
    shares = (np.arange(NUM_SLIPS) + rng.uniform(0.2, 0.8, NUM_SLIPS)) / NUM_SLIPS
    begins = shares * max(length - SLIP_LENGTH, 0.0)
    ahead = path_lengths - path_lengths[0]
    return [(ahead > begin) & (ahead <= begin + SLIP_LENGTH) for begin in begins.tolist()]


def _slipping(poses: FloatArray, path_lengths: FloatArray, rng: np.random.Generator) -> FloatArray:
    steps = relative_all(poses[:-1], poses[1:])
    distances = np.diff(path_lengths)
    drags, dragged_most, spins, spins_most = SLIP_FACTORS
    for within in slippery(path_lengths, rng):
        limits = (drags, dragged_most) if rng.random() < 0.5 else (spins, spins_most)
        factor, turn = rng.uniform(*limits), rng.uniform(-SLIP_TURN, SLIP_TURN)
        slips = within[1:]
        steps[slips, :2] *= factor
        steps[slips, 2] += turn * distances[slips]
    return _chained(poses[0], steps)


def _veering(poses: FloatArray, constant: float, amplitude: float, phase: float) -> FloatArray:
    """Return odometry whose heading turns too much on each metre, by what depends on it [rad/m]."""
    steps = relative_all(poses[:-1], poses[1:])
    heading = float(poses[0, 2])
    for step in steps:
        middle = heading + 0.5 * step[2]
        step[2] += (constant + amplitude * np.sin(middle - phase)) * step[0]
        heading += step[2]
    return _chained(poses[0], steps)


def _jumping(poses: FloatArray, rng: np.random.Generator) -> FloatArray:
    if len(poses) < 2:
        return poses
    steps = relative_all(poses[:-1], poses[1:])
    for at in (rng.uniform(0.1, 0.9, NUM_JUMPS) * len(steps)).astype(int).tolist():
        length, direction = rng.uniform(*JUMP_LENGTHS), rng.uniform(-np.pi, np.pi)
        steps[at, :2] += length * np.array((np.cos(direction), np.sin(direction)))
        steps[at, 2] += rng.uniform(-JUMP_TURN, JUMP_TURN)
    return _chained(poses[0], steps)


def _chained(first: FloatArray, steps: FloatArray) -> FloatArray:
    """Return the poses that steps lead to from the first one, shape (n, 3)."""
    headings = first[2] + np.concatenate(([0.0], np.cumsum(steps[:, 2])))
    turned = np.column_stack((np.zeros((len(steps), 2)), headings[:-1]))
    moved = np.cumsum(compose_all(turned, steps)[:, :2], axis=0)
    places = first[:2] + np.vstack((np.zeros((1, 2)), moved))
    return np.column_stack((places, wrap_angles(headings)))
