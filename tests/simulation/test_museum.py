# SPDX-License-Identifier: Apache-2.0
from collections import Counter
from functools import lru_cache

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from cartoloop.errors import ConfigError
from cartoloop.simulation import LIDARS, drive, large_museum, museum, museum_again
from cartoloop.simulation.museum_floor import museum_rooms
from cartoloop.simulation.museum_walls import museum_doors
from tests.simulation.wall_clearance import clearance_of_route

pytestmark = pytest.mark.slow

SEEDS = range(2)
museum_of = lru_cache(museum)


@pytest.fixture(scope="module")
def world():
    return museum_of(0)


def rooms_of(seed):
    return museum_rooms(np.random.default_rng(seed), 0.0)


def motion_of(world):
    return drive(world.route, *world.pace)


def way_until(motion):
    """Places a metre of way apart, shape (n, 2), and the way walked until each."""
    steps = np.hypot(*np.diff(motion.poses[:, :2], axis=0).T)
    walked = np.concatenate(([0.0], np.cumsum(steps)))
    at = np.arange(0.0, walked[-1], 1.0)
    return np.column_stack([np.interp(at, walked, motion.poses[:, k]) for k in (0, 1)]), at


@pytest.mark.parametrize("seed", SEEDS)
def test_the_floor_is_as_large_as_the_papers(seed):
    assert 21_000 < sum(room.area for room in rooms_of(seed)) < 23_000


@pytest.mark.parametrize("seed", SEEDS)
def test_rooms_are_many_of_all_sizes_and_never_overlap(seed):
    rooms = rooms_of(seed)
    areas = [room.area for room in rooms if room.kind == "gallery"]
    assert len(rooms) > 80
    assert max(areas) > 3 * min(areas)
    assert max(room.area for room in rooms) > 1000
    bounds = np.array([room.bounds for room in rooms])
    low = np.maximum(bounds[:, None, :2], bounds[:, :2])
    high = np.minimum(bounds[:, None, 2:], bounds[:, 2:])
    shared = np.maximum(high - low, 0.0).prod(axis=2)
    np.fill_diagonal(shared, 0.0)
    assert shared.max() < 1e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_every_room_can_be_reached_by_doors(seed):
    rooms = rooms_of(seed)
    doors = museum_doors(np.random.default_rng(seed), rooms)
    ends = np.array([door.rooms for door in doors])
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=[len(rooms)] * 2)
    assert connected_components(graph, directed=False)[0] == 1
    assert len(doors) > 1.2 * len(rooms)  # so there are loops
    assert min(door.width for door in doors) > 1.2


def test_some_rooms_look_alike_in_a_row():
    sizes = Counter(
        (round(room.width, 6), round(room.depth, 6))
        for room in rooms_of(0)
        if room.kind == "cabinet"
    )
    assert max(sizes.values()) >= 6


@pytest.mark.parametrize("seed", SEEDS)
def test_the_walk_is_as_long_as_the_papers(seed):
    motion = motion_of(museum_of(seed))
    assert 2200 < motion.path_length < 2310
    assert 1850 < motion.duration < 1970


@pytest.mark.parametrize("seed", SEEDS)
def test_the_walk_returns_every_few_hundred_metres(seed):
    places, walked = way_until(motion_of(museum_of(seed)))
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    again = ((apart < 1.2) & (walked[:, None] - walked > 60.0)).any(axis=1)
    returns = walked[again]
    assert np.diff(np.concatenate(([0.0], returns, walked[-1:]))).max() < 700.0
    assert again.mean() > 0.2


def test_the_walk_leads_through_all_of_the_floor(world):
    places = motion_of(world).poses[:, :2]
    assert (np.ptp(places, axis=0) > [150.0, 110.0]).all()


def test_it_is_carried_without_odometry(world):
    assert world.lidar is LIDARS["backpack"]
    assert not world.has_odometry


def test_a_large_museum_grows_in_area_and_path_length():
    large = large_museum(0, wings=2)
    assert 2 * 2200 < motion_of(large).path_length < 2 * 2310
    width, depth = np.ptp(large.walls.reshape(-1, 2), axis=0)
    assert width > 2 * 190.0
    assert depth < 150.0
    assert clearance_of_route(large) > 0.4


def test_museum_again_keeps_its_walls_while_the_path_grows(world):
    again = museum_again(0, walks=2)
    assert np.array_equal(again.walls, world.walls)
    assert np.array_equal(again.route[: len(world.route)], world.route)
    assert 2 * 2200 < motion_of(again).path_length < 2 * 2310
    assert clearance_of_route(again) > 0.4


def test_the_walks_of_the_museum_again_are_different():
    places, walked = way_until(motion_of(museum_again(0, walks=2)))
    first, second = places[walked < 2200], places[walked > 2320]
    apart = np.linalg.norm(second[:, None] - first[None], axis=2).min(axis=1)
    assert 0.2 < (apart > 2.0).mean() < 0.9


@pytest.mark.parametrize("build", [lambda: large_museum(0, 0), lambda: museum_again(0, -1)])
def test_a_museum_of_nothing_is_refused(build):
    with pytest.raises(ConfigError, match="at least one"):
        build()
