# SPDX-License-Identifier: Apache-2.0
"""The step that fits an outline best, against trying all of them one point after the other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.outline_shift import (
    STRETCH_M,
    add_shift_costs,
    best_step,
    open_direction,
)
from cartoloop.sensor.pose import Pose, inverse, transform_points
from tests.reference.naive_outline_shift import (
    naive_costs,
    naive_loss,
    naive_open_direction,
    naive_unseen_costs,
)

MAX_GAP, SIGMA, MAX_DISTANCE, OUTSIDE = 0.3, 0.05, 0.2, 0.3
FIT = SIGMA, MAX_DISTANCE, OUTSIDE, math.nan, math.nan
SHARED = SIGMA, MAX_DISTANCE, OUTSIDE, math.nan, OUTSIDE
STEP, REACH = 0.1, 2
ANY = 1.0, 0.0

seeds = st.integers(0, 2**32 - 1)


def scan_of(rng):
    """Return the ends of beams in a random room, in order."""
    count = int(rng.integers(2, 60))
    bearings = np.sort(rng.uniform(-math.pi, math.pi, count))
    return bearings, rng.uniform(0.5, 4.0, count)[:, None] * np.column_stack(
        (np.cos(bearings), np.sin(bearings))
    )


def costs_of_shifts(bearings, ends, places, along, shifts, unseen):
    """Return what all shifts of points along a direction cost, by the naive model."""
    return [
        sum(
            naive_costs(
                bearings, ends, MAX_GAP, places, (shift * along[0], shift * along[1]), FIT, unseen
            )
        )
        for shift in shifts
    ]


@settings(deadline=None, max_examples=150)
@given(
    seed=seeds,
    stride=st.integers(1, 4),
    below=st.sampled_from((ANY, (0.2, 0.0), (0.2, 1.0), (0.0, 100.0))),
)
def test_the_best_step_costs_least_of_all(seed, stride, below):
    rng = np.random.default_rng(seed)
    bearings, ends = scan_of(rng)
    direction, moved = rng.uniform(0.0, math.tau), float(rng.uniform(-0.5, 0.5))
    along = math.cos(direction), math.sin(direction)
    pose, hidden = Pose(*rng.uniform(-0.2, 0.2, 3).tolist()), float(rng.uniform(-0.6, 0.6))
    seen = ends[rng.random(len(ends)) < 0.8] - hidden * np.array(along)
    points = transform_points(inverse(pose), seen + rng.normal(0.0, 0.03, seen.shape))
    steps = STEP * np.arange(-6, 7)

    matched, best, noise, loss, costs = best_step(
        bearings, ends, MAX_GAP, points, pose[:], along, moved, steps, stride, below, REACH, FIT
    )

    places = transform_points(pose, points)
    unseen = [(cost, cost) for cost in naive_unseen_costs(bearings, ends, MAX_GAP, places, FIT)]
    matched_cost, *expected = costs_of_shifts(
        bearings, ends, places, along, [0.0, *(steps - moved).tolist()], unseen
    )
    assert matched == pytest.approx(matched_cost)
    limit = min(matched_cost, max(below[0] * matched_cost, below[1] * len(points)))
    if best < 0:
        assert stride > 1
        assert min(expected[::stride]) >= limit * (1.0 - 1e-9)
        assert np.isnan(costs).all()
        return
    assert expected[best] == pytest.approx(min(expected))
    assert stride == 1 or expected[best] <= limit * (1.0 + 1e-9)
    assert 0.0 <= noise <= math.sqrt(len(places)) * 0.25 * 0.5 * (MAX_DISTANCE / SIGMA) ** 2
    shift = ((steps[best] - moved) * along[0], (steps[best] - moved) * along[1])
    before, after = (
        naive_costs(bearings, ends, MAX_GAP, places, by, FIT, unseen) for by in ((0.0, 0.0), shift)
    )
    assert loss == pytest.approx(naive_loss(places, before, after, STRETCH_M), abs=1e-9)
    around = [best - REACH, best - 1, best, best + 1, best + REACH]
    wanted = [expected[k] if 0 <= k < len(steps) else math.nan for k in around]
    assert list(costs) == pytest.approx(wanted, nan_ok=True)


@settings(deadline=None, max_examples=100)
@given(seed=seeds)
def test_costs_of_shifts_are_added(seed):
    rng = np.random.default_rng(seed)
    bearings, ends = scan_of(rng)
    direction = rng.uniform(0.0, math.tau)
    along = math.cos(direction), math.sin(direction)
    pose = Pose(*rng.uniform(-0.2, 0.2, 3).tolist())
    points = transform_points(inverse(pose), ends + rng.normal(0.0, 0.03, ends.shape))
    shifts, before = STEP * np.arange(-3, 4), rng.uniform(0.0, 5.0, 7)
    costs = before.copy()

    add_shift_costs(
        bearings, ends, MAX_GAP, points, pose[:], along, shifts, SHARED, costs
    )  # fmt: skip

    places = transform_points(pose, points)
    beside = OUTSIDE * 0.5 * (MAX_DISTANCE / SIGMA) ** 2
    unseen = [(cost, beside) for cost in naive_unseen_costs(bearings, ends, MAX_GAP, places, FIT)]
    expected = costs_of_shifts(bearings, ends, places, along, shifts.tolist(), unseen)
    assert (costs - before).tolist() == pytest.approx(expected)


def test_of_equal_steps_the_first_is_best():
    bearings = np.array((-1.0, 1.0))
    ends = np.array(((1.0, -1.0), (1.0, 1.0)))  # a wall across x, no line: the gap is too wide
    steps = STEP * np.arange(-6, 7)
    for stride in (1, 3):
        *found, _ = best_step(
            bearings, ends, 0.1, ends, (0.0, 0.0, 0.0), (0.0, 1.0), 0.0, steps, stride, ANY, REACH,
            FIT,
        )  # fmt: skip
        outside = 2 * OUTSIDE * 0.5 * (MAX_DISTANCE / SIGMA) ** 2
        assert found == [pytest.approx(outside), 0 if stride == 1 else -1, 0.0, 0.0]


def test_points_that_leave_the_view_favour_no_step():
    # Two bare walls of a corridor along x, seen from -2 to 2 m by both scans.
    xs = np.linspace(2.0, -2.0, 81)
    left, right = np.column_stack((xs, np.ones(81))), np.column_stack((xs[::-1], -np.ones(81)))
    ends = np.concatenate((right, left))
    bearings = np.arctan2(ends[:, 1], ends[:, 0])
    order = np.argsort(bearings)
    steps = STEP * np.arange(-6, 7)

    *_, costs = best_step(
        bearings[order], ends[order], 0.1, ends, (0.3, 0.0, 0.0), (1.0, 0.0), 0.3, steps, 1, ANY,
        REACH, FIT,
    )  # fmt: skip

    seen = [cost for cost in costs if math.isfinite(cost)]
    assert len(seen) >= 3
    np.testing.assert_allclose(seen, seen[0], atol=1e-9)


@settings(deadline=None, max_examples=60)
@given(seed=seeds)
def test_the_open_direction_is_that_of_the_walls(seed):
    bearings, ends = scan_of(np.random.default_rng(seed))
    if not (np.diff(bearings) < MAX_GAP).any():
        assert open_direction(bearings, ends, MAX_GAP)[0] == 1.0
        return
    ratio, direction = naive_open_direction(bearings, ends, MAX_GAP)
    found = open_direction(bearings, ends, MAX_GAP)
    assert found[0] == pytest.approx(ratio, abs=1e-12)
    if ratio < 0.99:
        assert math.sin(found[1] - direction) == pytest.approx(0.0, abs=1e-9)


def test_the_noise_of_a_difference_is_bounded_for_each_point():
    rng = np.random.default_rng(0)
    angles = np.linspace(-1.0, 1.0, 41)
    ends = (2.0 / np.cos(angles))[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    bearings, noisy = np.arctan2(ends[:, 1], ends[:, 0]), rng.normal(0.0, 0.02, 41)
    points, steps = ends.copy(), STEP * np.arange(-6, 7)
    points[:, 0] += 0.3 + noisy  # a wall across x that is 0.3 m further away

    matched, best, noise, loss, costs = best_step(
        bearings, ends, 0.1, points, (0.0, 0.0, 0.0), (1.0, 0.0), 0.0, steps, 1, ANY, REACH, FIT
    )

    assert steps[best] == pytest.approx(-0.3)
    assert matched - costs[2] == pytest.approx(41 * 8.0, rel=0.1)
    assert noise == pytest.approx(math.sqrt(41) * 2.0)
    assert loss == 0.0
