# SPDX-License-Identifier: Apache-2.0
from collections import Counter

import numpy as np
import pytest

from cartoloop.errors import ConfigError
from cartoloop.simulation import drive, make_world, simulate
from tests.simulation.wall_clearance import clearance_of_route

ROBOT_RADIUS = 0.25
DAY_S = 86_400.0


def _segments(segments):
    return {tuple(segment) for segment in segments.round(6).tolist()}


def _faces(world):
    """Lines along the axes that hold more than 5 m of walls; furniture hides parts of them."""
    lengths = Counter()
    for x1, y1, x2, y2 in world.walls.round(6).tolist():
        if x1 == x2 or y1 == y2:
            lengths[("x", x1) if x1 == x2 else ("y", y1)] += abs(x2 - x1) + abs(y2 - y1)
    return {face for face, length in lengths.items() if length > 5.0}


@pytest.mark.slow
@pytest.mark.parametrize("number", range(2, 10))
def test_later_drives_never_come_near_a_wall(number):
    for seed in range(3):
        assert clearance_of_route(make_world("office", seed, number)) > ROBOT_RADIUS


def test_the_first_drive_is_the_world_itself():
    world, first = make_world("office", 3), make_world("office", 3, 1)
    assert np.array_equal(world.walls, first.walls)
    assert np.array_equal(world.route, first.route)


def test_a_later_drive_is_the_same_each_time():
    one, same, other = (make_world("office", 3, number) for number in (4, 4, 5))
    assert np.array_equal(one.walls, same.walls)
    assert np.array_equal(one.route, same.route)
    assert not np.array_equal(one.walls, other.walls)
    assert not np.array_equal(one.route, other.route)


def test_the_walls_stand_on_all_drives():
    first, later = make_world("office", 5), make_world("office", 5, 9)
    assert len(_faces(first)) > 30
    assert len(_faces(first) & _faces(later)) > 0.9 * len(_faces(first))


def test_from_drive_to_drive_a_quarter_is_changed():
    drives = [_segments(make_world("office", 1, number).furniture) for number in (1, 2, 20)]
    kept, kept_long = (len(drives[0] & later) / len(drives[0]) for later in drives[1:])
    assert 0.6 < kept < 0.9
    assert kept_long < 0.1
    assert 0.6 < len(drives[2]) / len(drives[0]) < 1.2


def test_later_drives_are_as_long_and_begin_elsewhere():
    starts = []
    for number in range(1, 6):
        world = make_world("office", 2, number)
        starts.append(tuple(world.route[0]))
        assert 200.0 < drive(world.route, *world.pace).path_length < 350.0
    assert len(set(starts)) == len(starts)


def test_drives_are_a_day_apart_with_noise_of_their_own():
    stills = [
        simulate(make_world("office", 1, number), seed=1, duration=1.0) for number in (1, 2, 3)
    ]
    stamps = [recording.stamps[0] for recording in stills]
    assert np.diff(stamps).tolist() == [DAY_S, DAY_S]
    odometry = {tuple(recording.odometry_poses[-1]) for recording in stills}
    assert len(odometry) == 3


@pytest.mark.parametrize(("name", "number"), [("yard", 2), ("office", 0)])
def test_a_drive_that_is_not_there_is_refused(name, number):
    with pytest.raises(ConfigError, match=f"no drive {number} through .*{name}.*office"):
        make_world(name, 0, number)
