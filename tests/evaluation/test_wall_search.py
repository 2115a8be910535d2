# SPDX-License-Identifier: Apache-2.0
"""Where a wall's face is found in a map image."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.evaluation.wall_search import wall_distance
from tests.evaluation.drawn_map import (
    FREE,
    OCCUPIED,
    UNKNOWN_SHADE,
    draw_wall,
    pixel_centres,
    room,
    unknown_map,
)

MIDDLE, RIGHT = np.array((5.0, 5.0)), np.array((1.0, 0.0))


def search_right(image, near=1.0, far=3.0):
    return wall_distance(image, MIDDLE, RIGHT, near, far)


def corridor_to(columns_m):
    """Free floor up to x = 7 m, 2 m from the middle, and dark columns from there on."""
    image = unknown_map(10.0, 10.0)
    image.occupancy[:, :140] = FREE
    image.occupancy[:, 140 : 140 + round(columns_m / image.resolution)] = OCCUPIED
    return image


@pytest.mark.parametrize(
    ("columns_m", "face"),
    [
        (0.05, 2.025),  # the hits of one face: their middle
        (0.10, 2.05),
        (0.15, 2.05),  # what is darker behind two pixels is not this face
        (2.00, 2.05),
    ],
)
def test_the_face_is_the_middle_of_the_first_two_dark_pixels(columns_m, face):
    assert search_right(corridor_to(columns_m)) == pytest.approx(face, abs=0.003)


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.75])
def test_grey_pixels_give_the_face_within_a_cell(share):
    image = corridor_to(0.05)
    image.occupancy[:, 140:142] = (0.5 + 0.5 * (1.0 - share), 0.5 + 0.5 * share)

    # centre of mass of two pixels with centres 2.025 and 2.075
    assert search_right(image) == pytest.approx(2.025 + 0.05 * share, abs=0.003)


def test_a_grey_pixel_before_the_first_occupied_one_counts():
    image = corridor_to(0.05)
    image.occupancy[:, 139] = 0.6

    # weights 0.1 at 1.975 and 0.5 at 2.025
    assert search_right(image) == pytest.approx((0.1 * 1.975 + 0.5 * 2.025) / 0.6, abs=0.003)


def test_unknown_of_a_map_of_probabilities_weighs_nothing():
    image = corridor_to(0.05)
    image.occupancy[image.occupancy == np.float32(UNKNOWN_SHADE)] = 0.498

    assert search_right(image) == pytest.approx(2.025, abs=0.003)


def test_the_other_face_of_the_same_wall_is_left_alone():
    image = corridor_to(0.05)
    image.occupancy[:, 143] = OCCUPIED

    assert search_right(image) == pytest.approx(2.025, abs=0.003)


def test_specks_are_no_wall():
    image = corridor_to(0.05)
    image.occupancy[100:102, 130:132] = OCCUPIED  # 10 cm square, 0.5 m before the wall
    image.occupancy[98, 136] = OCCUPIED

    assert search_right(image) == pytest.approx(2.025, abs=0.003)


def test_a_speck_right_before_the_wall_does_not_move_it():
    image = corridor_to(0.05)
    image.occupancy[99:101, 137:139] = OCCUPIED

    assert search_right(image) == pytest.approx(2.025, abs=0.003)


def test_scattered_specks_do_not_make_a_wall_together():
    image = unknown_map(10.0, 10.0)
    image.occupancy[:] = FREE
    for row, col in zip(range(97, 103), (122, 150, 133, 157, 141, 127), strict=True):
        image.occupancy[row, col] = OCCUPIED

    assert search_right(image) is None


def test_a_narrow_gap_is_bridged_and_a_door_is_not():
    narrow, door = corridor_to(0.05), corridor_to(0.05)
    narrow.occupancy[99:101, 140] = UNKNOWN_SHADE  # 10 cm
    door.occupancy[90:110, 140] = FREE  # 1 m

    assert search_right(narrow) == pytest.approx(2.025, abs=0.003)
    assert search_right(door) is None


def test_dark_pixels_without_free_floor_before_them_are_no_face():
    image = corridor_to(0.05)
    image.occupancy[:, :140] = UNKNOWN_SHADE

    assert search_right(image) is None


def test_a_fringe_of_unknown_before_the_wall_is_allowed():
    image = corridor_to(0.05)
    image.occupancy[:, 138:140] = UNKNOWN_SHADE

    assert search_right(image) == pytest.approx(2.025, abs=0.003)


def test_walls_out_of_reach_are_not_taken():
    image = corridor_to(0.05)

    assert search_right(image, near=2.1, far=3.0) is None
    assert search_right(image, near=1.0, far=1.9) is None


def test_the_first_wall_within_reach_counts():
    image = corridor_to(0.05)
    image.occupancy[:, 110] = OCCUPIED

    assert search_right(image, near=1.0) == pytest.approx(2.025, abs=0.003)
    assert search_right(image, near=0.3) == pytest.approx(0.525, abs=0.003)


@pytest.mark.parametrize("degrees", [10, 30, 45])
def test_an_oblique_wall_is_measured_on_the_line_itself(degrees):
    image = unknown_map(10.0, 10.0)
    slope = math.tan(math.radians(degrees))
    centres = pixel_centres(image)
    image.occupancy[centres[..., 0] < 7.03 + slope * (centres[..., 1] - 5.0)] = FREE
    draw_wall(image, (7.03 - 2.0 * slope, 3.0), (7.03 + 2.0 * slope, 7.0))

    assert search_right(image) == pytest.approx(2.03, abs=0.03)


@pytest.mark.parametrize("resolution", [0.005, 0.02, 0.1, 0.25])
def test_works_at_any_resolution(resolution):
    image = room(4.0, 4.0, resolution=resolution)

    assert search_right(image) == pytest.approx(2.0, abs=resolution)


def test_a_lone_dark_pixel_is_no_wall_however_large():
    image = unknown_map(10.0, 10.0, resolution=0.25)
    image.occupancy[:] = FREE
    image.occupancy[20, 28] = OCCUPIED

    assert search_right(image) is None


def test_low_thresholds_are_heeded():
    image = replace(corridor_to(0.05), occupied_thresh=0.3)
    image.occupancy[image.occupancy == OCCUPIED] = 0.4

    assert search_right(image) == pytest.approx(2.025, abs=0.003)
