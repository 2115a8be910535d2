# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cartoloop.kernels.wall_ranges import wall_ranges
from tests.reference.naive_wall_ranges import naive_wall_ranges

RANGE_MAX = 12.0
coordinate = st.integers(-100, 100).map(lambda tenth: tenth / 10)
segment = st.tuples(coordinate, coordinate, coordinate, coordinate)
angle = st.floats(-4.0, 4.0)


def cast(walls, poses, angle_min, angle_increment, num_beams, range_max=RANGE_MAX):
    ranges = np.empty((len(poses), num_beams))
    wall_ranges(walls, poses, angle_min, angle_increment, range_max, ranges)
    return ranges


def stretched(walls, by):
    """The walls made longer by `by` [m] at both ends."""
    along = walls[:, 2:] - walls[:, :2]
    along *= by / np.linalg.norm(along, axis=1, keepdims=True)
    return np.hstack((walls[:, :2] - along, walls[:, 2:] + along))


@settings(deadline=None, max_examples=150)
@given(
    walls=st.lists(segment, min_size=1, max_size=12).map(lambda rows: np.array(rows, dtype=float)),
    poses=st.lists(st.tuples(coordinate, coordinate, angle), min_size=1, max_size=3).map(np.array),
    angle_min=angle,
    field_of_view=st.floats(0.1, math.tau),
    num_beams=st.integers(2, 60),
)
def test_ranges_equal_the_naive_intersection_with_all_walls(
    walls, poses, angle_min, field_of_view, num_beams
):
    ax, ay = walls[:, 0] - poses[:, :1], walls[:, 1] - poses[:, 1:2]
    length = np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1])
    assume((length > 0.05).all())
    across = (ax * (walls[:, 3] - walls[:, 1]) - ay * (walls[:, 2] - walls[:, 0])) / length
    assume((np.abs(across) > 1e-3).all())
    increment = field_of_view / num_beams
    angles = angle_min + increment * np.arange(num_beams)

    ranges = cast(walls, poses, angle_min, increment, num_beams)

    # At a wall's very end rounding decides: longer walls bound the range below, shorter above.
    nearest = naive_wall_ranges(stretched(walls, 1e-6), poses, angles, RANGE_MAX + 1e-6)
    farthest = naive_wall_ranges(stretched(walls, -1e-6), poses, angles, RANGE_MAX - 1e-6)
    assert (ranges >= nearest - 1e-9 * RANGE_MAX / 1e-3).all()
    assert (ranges <= farthest + 1e-9 * RANGE_MAX / 1e-3).all()


@pytest.mark.parametrize("heading", np.linspace(-7.0, 7.0, 29))
def test_no_beam_slips_through_the_corners_of_a_closed_room(heading):
    room = np.array([[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]], dtype=float)
    poses = np.array([[1.0, 1.0, heading], [0.3, 2.2, -heading]])
    to_corner = math.atan2(2.0, 3.0)  # from the first pose
    ranges = cast(room, poses, to_corner - heading, math.tau / 360, 360)
    assert np.isfinite(ranges).all()
    assert ranges[0, 0] == pytest.approx(math.hypot(2.0, 3.0))


def test_a_full_turn_sees_a_square_room_at_its_exact_distances():
    room = np.array([[-2, -2, 2, -2], [2, -2, 2, 2], [2, 2, -2, 2], [-2, 2, -2, -2]], dtype=float)
    ranges = cast(room, np.zeros((1, 3)), -math.pi, math.pi / 4, 8)
    diagonal = 2 * math.sqrt(2)
    assert ranges[0] == pytest.approx([2, diagonal, 2, diagonal, 2, diagonal, 2, diagonal])


def test_the_nearest_wall_counts_in_any_order():
    walls = np.array([[3, -1, 3, 1], [1, -1, 1, 1], [2, -1, 2, 1]], dtype=float)
    for order in ([0, 1, 2], [1, 0, 2], [2, 1, 0]):
        assert cast(walls[order], np.zeros((1, 3)), 0.0, 1.0, 1)[0, 0] == 1.0


def test_walls_out_of_range_behind_or_of_no_length_are_unseen():
    walls = np.array([[13, -1, 13, 1], [-1, -0.5, -1, 0.5], [1, 0, 1, 0]], dtype=float)
    assert np.isinf(cast(walls, np.zeros((1, 3)), -0.1, 0.1, 3)).all()


def test_a_wall_that_starts_out_of_range_is_seen_where_near():
    walls = np.array([[-500, 2, 500, 2]], dtype=float)
    ranges = cast(walls, np.zeros((1, 3)), 0.0, math.pi / 180, 181)
    assert ranges[0, 90] == pytest.approx(2.0)
    assert np.isinf(ranges[0, :9]).all()
    assert ranges[0, 10] == pytest.approx(2 / math.sin(math.radians(10)))


def test_no_walls_at_all_give_no_returns():
    assert np.isinf(cast(np.empty((0, 4)), np.zeros((2, 3)), 0.0, 0.1, 5)).all()
