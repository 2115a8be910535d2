# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from cartoloop.errors import ConfigError
from cartoloop.simulation import WORLDS, FloorPlan, Opening, drive, make_lidar, make_world
from cartoloop.simulation.floor_plan import outline_of_boxes
from cartoloop.simulation.lidar import true_ranges
from tests.simulation.wall_clearance import clearance_of_route

pytestmark = pytest.mark.slow

ROBOT_RADIUS = 0.25


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", sorted(WORLDS))
def test_the_robot_never_comes_near_a_wall(name, seed):
    world = make_world(name, seed)
    assert clearance_of_route(world) > ROBOT_RADIUS


@pytest.mark.parametrize("name", sorted(WORLDS))
def test_a_world_is_made_of_its_seed(name):
    one, same, other = (make_world(name, seed) for seed in (3, 3, 4))
    assert one.name == name
    assert one.walls.dtype == np.float64
    assert one.walls.shape[1] == 4
    assert np.array_equal(one.walls, same.walls)
    assert np.array_equal(one.route, same.route)
    assert not np.array_equal(one.walls, other.walls)


@pytest.mark.parametrize(("name", "shortest", "longest"), [
    ("office", 250.0, 350.0), ("corridor", 140.0, 170.0), ("ring", 150.0, 190.0),
    ("museum", 2200.0, 2300.0), ("flat", 95.0, 115.0), ("bare", 170.0, 180.0),
    ("hall", 560.0, 640.0), ("wings", 180.0, 400.0), ("campus", 2000.0, 2400.0),
    ("yard", 680.0, 740.0),
])  # fmt: skip
def test_routes_are_as_long_as_they_should_be(name, shortest, longest):
    world = make_world(name)
    assert shortest < drive(world.route, *world.pace).path_length < longest


def test_the_office_is_a_floor_of_50_by_30_metres():
    corners = make_world("office").walls.reshape(-1, 2)
    assert np.ptp(corners, axis=0) == pytest.approx([50.0, 30.0], abs=0.5)


def test_the_office_route_returns_after_long_loops():
    motion = drive(make_world("office").route)
    times = np.arange(0.0, motion.duration, 1.0)
    points = motion.poses_at(times)[:, :2]
    near = np.linalg.norm(points[:, None] - points, axis=2) < 1.0
    much_later = times[None] - times[:, None] > 60.0
    assert (near & much_later).any(axis=1).sum() > 60


def test_walls_have_gaps_at_doors_and_panels_in_shut_ones():
    plan = FloorPlan()
    plan.wall((0.0, 0.0), (10.0, 0.0), [Opening(7.0, 1.0, closed=True), Opening(3.0, 1.0)], 0.2)
    expected = [
        (-0.1, -0.1, 2.5, 0.1), (3.5, -0.1, 6.5, 0.1), (6.5, -0.025, 7.5, 0.025),
        (7.5, -0.1, 10.1, 0.1),
    ]  # fmt: skip
    assert np.array(plan.solids) == pytest.approx(np.array(expected))


def test_walls_run_in_any_direction_along_an_axis():
    plan = FloorPlan()
    plan.wall((1.0, 5.0), (1.0, 1.0), thickness=0.2)
    assert plan.solids[0] == pytest.approx((0.9, 0.9, 1.1, 5.1))


def test_edges_inside_other_boxes_are_left_out():
    edges = outline_of_boxes([(0.0, 0.0, 4.0, 1.0), (1.0, 0.5, 2.0, 3.0)])
    assert sorted(edges) == [
        (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 4.0, 0.0), (0.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 3.0),
        (1.0, 3.0, 2.0, 3.0), (2.0, 1.0, 2.0, 3.0), (2.0, 1.0, 4.0, 1.0), (4.0, 0.0, 4.0, 1.0),
    ]  # fmt: skip


def test_an_empty_plan_has_no_segments():
    assert FloorPlan().segments().shape == (0, 4)


def test_an_unknown_world_is_refused_with_the_nearest_name():
    with pytest.raises(ConfigError, match=r"'offce'.*nearest: office"):
        make_world("offce")


def test_the_wings_are_the_same_but_for_their_place():
    world = make_world("wings", 2)
    motion = drive(world.route, *world.pace)
    poses = motion.poses_at(np.arange(0.0, motion.duration, 0.5))
    shift = _shift_of_wings(world)
    inside = [pose for pose in poses if pose[1] > 9.0 and pose[0] < shift / 2]
    assert len(inside) > 20
    here = np.array(inside)
    there = here + np.array((shift, 0.0, 0.0))
    lidar = make_lidar("sick")
    assert true_ranges(world.walls, here, lidar) == pytest.approx(
        true_ranges(world.walls, there, lidar), abs=1e-6
    )


def _shift_of_wings(world):
    """From a wall of the western wing to the same one of the eastern wing [m]."""
    northernmost = world.walls[:, 1].max()
    x = np.sort(world.walls[world.walls[:, 1] == northernmost][:, 0])
    return x[len(x) // 2] - x[0]


def test_in_the_middle_of_the_hall_nothing_is_seen():
    world = make_world("hall")
    motion = drive(world.route, *world.pace)
    poses = motion.poses_at(np.arange(0.0, motion.duration, 1.0))
    blind = np.isinf(true_ranges(world.walls, poses, make_lidar("sick-180"))).all(axis=1)
    assert 0.1 < blind.mean() < 0.3


def test_a_robot_sets_off_along_bare_walls():
    world = make_world("bare", 1)
    near = world.walls[(world.walls[:, [0, 2]].max(axis=1) < 19.0)]
    assert np.ptp(near[:, [1, 3]], axis=1).max() < 2.5  # the end wall, and no door or box
    ahead = world.walls[(world.walls[:, [0, 2]].min(axis=1) > 1.0)]
    faces = np.unique(ahead[ahead[:, 0] < 20.0][:, [1, 3]].round(3))
    assert len(faces) <= 8
