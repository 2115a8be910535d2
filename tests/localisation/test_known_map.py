# SPDX-License-Identifier: Apache-2.0
"""Maps as localisation uses them: of ours, and images of other programs."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from cartoloop.errors import InputError
from cartoloop.localisation.global_search import find
from cartoloop.localisation.known_map import known_map_of, known_map_of_image, load_known_map
from cartoloop.map_output.save import save
from cartoloop.sensor.pose import IDENTITY, Pose
from tests.localisation.rooms import BOX, ROOM, START, apart, image, known_map, points
from tests.map_output.small_result import small_result


@pytest.mark.parametrize(
    ("resolution", "origin"),
    [(0.05, IDENTITY), (0.1, IDENTITY), (0.02, IDENTITY), (0.05, Pose(2.0, -3.0, 0.4))],
)
def test_a_scan_is_found_whatever_the_image(resolution, origin):
    known = known_map(ROOM, resolution, origin)

    found = find(known, points(ROOM, START), 0.4)

    distance, angle = apart(START, found.tf_map_tracking)
    assert distance < 0.15
    assert angle < 1.5


def test_scans_fit_where_they_were_measured_and_not_elsewhere():
    known = known_map(ROOM)
    scan = points(ROOM, START)

    here = known.fit(scan, IDENTITY, START)
    elsewhere = known.fit(scan, IDENTITY, Pose(7.5, 8.0, 0.3))

    assert here.agreement > 0.95
    assert elsewhere.agreement < 0.6
    assert here.score > elsewhere.score + 0.2


def test_straight_walls_are_no_detail():
    corridor = (((1, 1), (21, 1), (21, 3), (1, 3)),)
    here = Pose(11.0, 2.0, 0.1)

    straight = known_map(corridor).fit(points(corridor, here), IDENTITY, here)
    room = known_map(ROOM).fit(points(ROOM, START), IDENTITY, START)

    assert straight.agreement > 0.95
    assert straight.detail < 0.1
    assert 0.2 < room.detail < room.agreement


def test_beams_pass_thin_objects_of_the_map():
    def agreement(size):
        post = ((6.0, 3.0), (6.0 + size, 3.0), (6.0 + size, 3.0 + size), (6.0, 3.0 + size))
        known = known_map((*BOX, post))
        return known.fit(points(BOX, START), IDENTITY, START).agreement

    assert agreement(0.1) == 1.0
    assert agreement(0.4) < 0.97


def test_thin_parts_of_the_unknown_block_beams():
    shown = image((*BOX, ((6.0, 3.0), (6.1, 3.0), (6.1, 3.1), (6.0, 3.1))))
    occupancy = shown.occupancy.copy()
    near = occupancy[54:69, 114:129]
    near[near == 0.0] = -1.0

    known = known_map_of_image(dataclasses.replace(shown, occupancy=occupancy))

    assert known.fit(points(BOX, START), IDENTITY, START).agreement < 1.0


def test_unknown_pixels_count_neither_for_nor_against_a_pose():
    known = known_map(BOX)
    outside = np.array(((0.0, 7.0), (0.5, 7.2)))

    fit = known.fit(outside, IDENTITY, Pose(20.0, 20.0, 0.0))

    assert fit.num_counted == 0
    assert math.isnan(fit.agreement)


def test_a_map_without_walls_is_refused():
    empty = image(ROOM)
    empty.occupancy[empty.occupancy > 0.5] = 0.0

    with pytest.raises(InputError, match="no walls"):
        known_map_of_image(empty)


def test_own_maps_and_their_images_are_read_from_a_folder(tmp_path):
    result = small_result()
    save(result, tmp_path)

    own = load_known_map(tmp_path)
    foreign = load_known_map(tmp_path / "map.yaml")

    assert own.usual == known_map_of(result).usual
    assert own.grid.resolution == foreign.grid.resolution


def test_a_map_that_is_not_there_is_reported(tmp_path):
    with pytest.raises(InputError, match="is not there"):
        load_known_map(tmp_path / "nothing")
