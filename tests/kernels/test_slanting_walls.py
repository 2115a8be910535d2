# SPDX-License-Identifier: Apache-2.0
"""Beams that a slanting wall may hide, against a slow and obvious reference."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.kernels.slanting_walls import hide_beyond_slanting_walls

STEP, MIN_RANGE, NO_RETURN, LENGTH = math.radians(1.0), 0.1, 30.0, 5.0
NUM_BEAMS, MIN_SLANT, MAX_BEND = 3, 1.0, 0.1


def hidden_in(ranges):
    """Return the beams that are hidden."""
    ranges = np.asarray(ranges, dtype=float)
    out = np.empty(len(ranges))
    count = hide_beyond_slanting_walls(
        ranges, STEP, MIN_RANGE, NO_RETURN, LENGTH, NUM_BEAMS, MIN_SLANT, MAX_BEND, out
    )
    hidden = np.isnan(out) & ~np.isnan(ranges)
    np.testing.assert_array_equal(out[~hidden], ranges[~hidden])
    assert count == hidden.sum()
    return set(np.flatnonzero(hidden).tolist())


def is_missing(measured):
    return measured >= NO_RETURN


def naive_hidden(ranges):
    """By points and lines: where the line through two returns crosses a beam."""
    hidden = set()
    for order in (list(range(len(ranges))), list(range(len(ranges)))[::-1]):
        for place in range(1, len(order)):
            run = []
            while place + len(run) < len(order) and is_missing(ranges[order[place + len(run)]]):
                run.append(order[place + len(run)])
            last = order[place - 1]
            if not run or is_missing(ranges[last]):
                continue
            wall = wall_before(ranges, order[:place])
            if wall is None:
                continue
            for beam in run:
                if not crossing(wall, beam) < LENGTH:
                    break
                hidden.add(beam)
    return hidden


def point(ranges, beam):
    return ranges[beam] * np.array((math.cos(beam * STEP), math.sin(beam * STEP)))


def wall_before(ranges, beams):
    """The two ends of the wall that the last of some beams see, None if it does not slant."""
    last, far = beams[-1], None
    for back in range(NUM_BEAMS, 2 * NUM_BEAMS + 1):
        if back >= len(beams):
            return None
        if not is_missing(ranges[beams[-1 - back]]):
            far = beams[-1 - back]
            break
    if far is None or not (ranges[far] >= MIN_RANGE and ranges[last] >= MIN_RANGE):
        return None
    ends = point(ranges, far), point(ranges, last)
    for beam in beams[beams.index(far) : -1]:
        if is_missing(ranges[beam]):
            continue
        along = crossing(ends, beam)
        if not ranges[beam] >= MIN_RANGE or not abs(along / ranges[beam] - 1.0) <= MAX_BEND:
            return None
    # the slant is the growth of the range, for each radian, as a share of it
    beyond = 1e-6 * (1 if last > far else -1)
    slant = (crossing(ends, last + beyond) - ranges[last]) / (abs(beyond) * STEP * ranges[last])
    return ends if slant >= MIN_SLANT else None


def crossing(wall, beam):
    """Range at which a beam crosses a line, inf where it does not."""
    (x0, y0), (x1, y1) = wall
    cos, sin = math.cos(beam * STEP), math.sin(beam * STEP)
    across = (y1 - y0) * cos - (x1 - x0) * sin
    if abs(across) < 1e-12:
        return math.inf
    along = ((y1 - y0) * x0 - (x1 - x0) * y0) / across
    return along if along > 0.0 else math.inf


@given(
    st.lists(
        st.one_of(
            st.floats(0.05, 8.0), st.sampled_from([math.inf, 81.9, math.nan, 0.0, NO_RETURN])
        ),
        min_size=1,
        max_size=25,
    ),
)
def test_any_scan_hides_what_its_walls_hide(ranges):
    assert hidden_in(ranges) == naive_hidden(ranges)


@given(
    st.floats(0.4, 4.0),
    st.integers(20, 70),
    st.integers(0, 1000),
    st.floats(0.0, 0.4),
    st.booleans(),
)
def test_a_wall_that_is_lost_at_a_slant_is_hidden(distance, shown, seed, missing, is_left):
    rng = np.random.default_rng(seed)
    # no beam meets the wall at 45 degrees but for rounding errors
    ranges = distance / np.cos(STEP * (np.arange(90) + 0.37))
    ranges[shown:] = 81.9
    ranges[rng.random(90) < missing] = 81.9
    if is_left:
        ranges = ranges[::-1].copy()
    assert hidden_in(ranges) == naive_hidden(ranges)


def test_a_wall_along_the_path_is_no_free_space():
    beams = np.arange(90)
    ranges = 1.0 / np.cos(STEP * beams)
    ranges[70:] = 81.9
    # at 78.5 degrees it would be 5 m away
    assert hidden_in(ranges) == set(range(70, 79))
    assert hidden_in(ranges[::-1]) == {89 - beam for beam in range(70, 79)}


@pytest.mark.parametrize("shown", [30, 44])
def test_an_opening_in_a_wall_seen_straight_on_is_free_space(shown):
    ranges = 1.0 / np.cos(STEP * np.arange(90))
    ranges[shown:] = 81.9
    assert hidden_in(ranges) == set()


def test_a_corner_shows_no_direction_of_a_wall():
    ranges = 1.0 / np.cos(STEP * np.arange(90))
    ranges[70:] = 81.9
    ranges[67:69] *= 1.5
    assert hidden_in(ranges) == set()
