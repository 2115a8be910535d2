# SPDX-License-Identifier: Apache-2.0
"""Which poses of a trajectory are so and so far apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.errors import ConfigError

IndexArray = NDArray[np.int64]

DELTA_TOLERANCE = 0.1
"""Largest difference of a span from the length asked for, as a share of that length."""


def frame_pairs(num_poses: int, delta: float, all_pairs: bool) -> tuple[IndexArray, IndexArray]:
    """Return the rows of the first and of the second pose of each pair, `delta` rows apart.

    Parameters
    ----------
    num_poses : how many there are.
    delta : a whole number, not below 1.
    all_pairs : whether a pair starts at every pose, or where the last one ended.

    Raises
    ------
    ConfigError
        `delta` is no such number.
    """
    if not (delta >= 1.0 and float(delta).is_integer()):
        raise ConfigError(f"a delta of {delta:g} frames is impossible: give a whole number from 1")
    first = np.arange(0, num_poses - int(delta), 1 if all_pairs else int(delta), dtype=np.int64)
    return first, first + int(delta)


def span_pairs(places: FloatArray, delta: float, all_pairs: bool) -> tuple[IndexArray, IndexArray]:
    """Return the rows of the first and of the second pose of each pair that is `delta` apart.

    Parameters
    ----------
    places : float64 (n,), where each pose is along the path or in time; they never decrease.
    delta : the span, in the unit of `places`.
    all_pairs : whether a pair starts at every pose and ends at the one nearest to `delta`, if that
        is within :data:`DELTA_TOLERANCE` of it; otherwise it starts where the last one ended, and
        ends at the first pose that is at least `delta` away.

    Raises
    ------
    ConfigError
        `delta` is not above 0.
    """
    if not (delta > 0.0 and np.isfinite(delta)):
        raise ConfigError(f"a delta of {delta:g} is impossible: give one above 0")
    if all_pairs:
        return _nearest_pairs(places, delta)
    return _consecutive_pairs(np.diff(places).tolist(), delta)


def _nearest_pairs(places: FloatArray, delta: float) -> tuple[IndexArray, IndexArray]:
    num = len(places)
    first = np.arange(num - 1, dtype=np.int64)
    wanted = places[:-1] + delta
    beyond = np.minimum(np.searchsorted(places, wanted), num - 1)
    # Of several poses at one place (a robot that stands) the first one after the start counts.
    after = np.maximum(np.searchsorted(places, places[beyond]), first + 1)
    before = np.maximum(np.searchsorted(places, places[np.maximum(beyond - 1, 0)]), first + 1)
    off_after = np.abs(places[after] - places[:-1] - delta)
    off_before = np.abs(places[before] - places[:-1] - delta)
    second = np.where(off_before <= off_after, before, after)
    near = np.minimum(off_before, off_after) <= DELTA_TOLERANCE * delta
    return first[near], second[near]


def _consecutive_pairs(steps: Sequence[float], delta: float) -> tuple[IndexArray, IndexArray]:
    # Summed from zero for each span, so that rounding does not depend on where the span lies.
    ends, length = [0], 0.0
    for index, step in enumerate(steps, start=1):
        length += step
        if length >= delta:
            ends.append(index)
            length = 0.0
    return np.array(ends[:-1], dtype=np.int64), np.array(ends[1:], dtype=np.int64)
