# SPDX-License-Identifier: Apache-2.0
"""The facts of a map: extent, area, length of the way, resolution, verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.map_output.map_facts import map_facts
from cartoloop.map_output.occupancy_map import OccupancyMap
from cartoloop.map_output.surveyed_floor import surveyed
from cartoloop.quality.verdict import Quality
from cartoloop.report import InputSummary
from tests.map_output.small_result import small_result

RESOLUTION = 0.05
FREE_BELOW = 0.196


def room(width=6.0, height=4.0, sure=0.01):
    """A room with walls around its floor, in a map of 30 m by 30 m whose corner is at (-5, -7)."""
    probability = np.full((600, 600), -1.0, dtype=np.float32)
    rows, cols = round(height / RESOLUTION), round(width / RESOLUTION)
    probability[200 : 200 + rows, 100 : 100 + cols] = 0.99
    probability[201 : 199 + rows, 101 : 99 + cols] = sure
    return probability


def seen(probability, path=((1.0, 4.0),)):
    """What was surveyed of a map, by a robot that was in the room."""
    grid = OccupancyMap(probability, -5.0, -7.0, RESOLUTION)
    return surveyed(grid, FREE_BELOW, np.reshape(path, (-1, 2)))


def test_extent_of_a_room_includes_its_walls():
    extent, area_m2 = seen(room())

    assert (extent.width, extent.height) == (pytest.approx(6.0), pytest.approx(4.0))
    assert (extent.left, extent.bottom) == (pytest.approx(0.0), pytest.approx(3.0))
    assert area_m2 == pytest.approx(5.9 * 3.9)


def test_rays_that_stray_through_a_window_do_not_count():
    probability = room()
    for ray in range(8):  # from the middle of the right wall outwards, ever further apart
        cols = np.arange(220, 560)
        rows = 240 + ((cols - 215) * (ray - 4) * 0.04).astype(int)
        probability[rows, cols] = 0.15
        probability[rows[-1], 560] = 0.9

    assert seen(probability)[0] == seen(room())[0]
    assert seen(probability)[1] == pytest.approx(seen(room())[1], rel=0.01)


def test_a_map_of_few_scans_has_an_extent_too():
    extent, _ = seen(room(sure=0.15))

    assert (extent.width, extent.height) == (pytest.approx(6.0), pytest.approx(4.0))


def test_a_map_without_anything_seen_has_no_extent():
    nothing = OccupancyMap(np.full((1, 1), -1.0, np.float32), 0, 0, 0.05)

    assert surveyed(nothing, 0.2, np.zeros((1, 2))) == (None, 0.0)


def hall_before(probability, free):
    """The room, and a hall of 10 m left of it that was not passed again; a door is between them."""
    first = room()
    first[199:301, 0:101] = 0.99
    first[200:300, 1:100] = free
    first[220:260, 100] = free  # the door
    seen_there = (first >= 0.0) & (probability < 0.0)
    return np.where(seen_there | (np.arange(600) == 100), first, probability)


def test_floor_that_was_passed_once_was_surveyed():
    path = [(x, 5.0) for x in np.arange(-4.0, 5.0, 0.3)]

    extent, area_m2 = seen(hall_before(room(), free=0.1), path)

    assert (extent.left, extent.right) == (pytest.approx(-5.0), pytest.approx(6.0))
    assert area_m2 == pytest.approx(5.9 * 3.9 + 4.95 * 5.0, rel=0.05)


def test_a_place_seen_through_a_door_in_passing_was_not():
    extent, area_m2 = seen(hall_before(room(), free=0.15))

    assert extent.left > -1.5  # the robot was 1 m from the door
    assert area_m2 < 5.9 * 3.9 + 1.5 * 5.0


def test_floor_beside_the_start_was_surveyed():
    path = [(x, 5.0) for x in np.arange(-4.0, 5.0, 0.3)]

    extent, _ = seen(hall_before(room(), free=0.15), path)

    assert extent.left == pytest.approx(-5.0)


def test_the_path_lies_in_the_extent():
    extent, _ = seen(room(), path=[(1.0, 4.0), (np.nan, np.nan), (-4.0, 9.0), (40.0, 4.0)])

    assert (extent.left, extent.right) == (pytest.approx(-4.0), pytest.approx(40.0))
    assert (extent.bottom, extent.top) == (pytest.approx(3.0), pytest.approx(9.0))


def test_facts_are_those_of_the_run():
    result = small_result(
        finished=True, quality=Quality("good"),
        input=InputSummary("a.log", scans=3, duration_s=0.4, path_length_m=123.4),
    )  # fmt: skip

    facts = map_facts(result)

    assert (facts.name, facts.finished, facts.verdict) == ("a.log", True, "good")
    assert (facts.scans, facts.loop_closures, facts.resolution) == (3, 1, 0.05)
    assert (facts.extent.width, facts.extent.height) == pytest.approx((3.0, 2.0), abs=0.15)
    assert dict(facts.described()) == {
        "extent": f"{facts.extent.width:.1f} m × {facts.extent.height:.1f} m",
        "floor area": f"{facts.area_m2:.1f} m²",
        "length of the way": "123 m",
        "resolution": "5 cm",
        "verdict": "good",
    }
    assert facts.caption()[0] == "a.log"
    assert all(part.isascii() for part in facts.caption())  # the font of pictures has no more


def test_a_stopped_run_is_not_called_finished():
    stopped = small_result(finished=False)

    facts = map_facts(stopped)

    assert not facts.finished
    assert dict(facts.described())["verdict"] == "not examined: mapping was stopped"
    assert map_facts(replace(stopped, submap_grids=[], graph=PoseGraph())).extent is None
