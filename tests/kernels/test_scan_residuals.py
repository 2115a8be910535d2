# SPDX-License-Identifier: Apache-2.0
"""(CS): the normal equations and their minimum."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares, minimize

from cartoloop.kernels.scan_residuals import (
    MIN_DAMPING,
    MatchOptions,
    MotionPrior,
    accumulate_match,
    match_least_squares,
    solve_3x3,
)
from cartoloop.kernels.smooth_map import SmoothMap, point_scratch
from tests.reference.naive_scan_residuals import central_differences, naive_errors

UNKNOWN = 0.1

seeds = st.integers(0, 2**32 - 1)


def random_grid(seed, shape):
    """Probabilities, a third of the cells never observed."""
    rng = np.random.default_rng(seed)
    grid = rng.uniform(0.1, 0.9, shape)
    grid[rng.random(shape) < 0.3] = 0.0
    return grid.astype(np.float32)


def projected(jacobian, angles, points, theta):
    """A Jacobian without the derivatives along the walls of points; angles in the scan's frame."""
    cos, sin = math.cos(theta), math.sin(theta)
    result = []
    for (jx, jy, _), angle, (x, y) in zip(jacobian, angles, points, strict=True):
        across = np.array((jx, jy))
        if not math.isnan(angle):
            normal = np.array((-math.sin(angle + theta), math.cos(angle + theta)))
            across = (across @ normal) * normal
        arm_x, arm_y = cos * x - sin * y, sin * x + cos * y
        result.append((*across, across[1] * arm_x - across[0] * arm_y))
    return np.array(result)


@settings(deadline=None, max_examples=40)
@given(
    seed=seeds,
    num_points=st.integers(1, 12),
    x=st.floats(-1.0, 1.0),
    y=st.floats(-1.0, 1.0),
    theta=st.floats(-7.0, 7.0),
    share_of_walls=st.sampled_from([0.0, 0.5, 1.0]),
)
def test_the_normal_equations_equal_finite_differences(
    seed, num_points, x, y, theta, share_of_walls
):
    grid, origin, resolution = random_grid(seed, (20, 24)), (-1.0, -1.1), 0.1
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.6, 0.6, (num_points, 2))
    angles = rng.uniform(-4.0, 4.0, num_points)
    angles[rng.random(num_points) >= share_of_walls] = np.nan

    def errors(pose):
        return naive_errors(grid, UNKNOWN, origin, resolution, points, pose)

    system = np.empty(9)
    total = accumulate_match(
        SmoothMap(grid, *origin, resolution),
        UNKNOWN,
        points,
        np.nan_to_num(np.stack((np.cos(2.0 * angles), np.sin(2.0 * angles)))),
        x,
        y,
        theta,
        point_scratch(num_points),
        system,
    )

    at = errors((x, y, theta))
    jacobian = projected(central_differences(errors, (x, y, theta), 1e-7), angles, points, theta)
    assert total == pytest.approx(at @ at)
    normal = (jacobian.T @ jacobian)[np.triu_indices(3)]
    assert system[:6] == pytest.approx(normal, rel=1e-4, abs=1e-3)
    assert system[6:] == pytest.approx(jacobian.T @ at, rel=1e-4, abs=1e-3)


@settings(deadline=None, max_examples=60)
@given(seed=seeds, damping=st.floats(0.0, 10.0))
def test_the_damped_equations_are_solved(seed, damping):
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(5, 3)) * (1.0, 10.0, 0.1)
    normal, right = factor.T @ factor, rng.normal(size=3)
    step = np.zeros(3)
    assert solve_3x3(np.append(normal[np.triu_indices(3)], right), damping, step)
    own = min(damping, MIN_DAMPING)
    isotropic = (damping - own) * 0.5 * (normal[0, 0] + normal[1, 1])
    added = own * np.diag(normal) + isotropic
    added[2] = damping * normal[2, 2]
    damped = normal + np.diag(added)
    assert damped @ step == pytest.approx(-right, abs=1e-6)


@pytest.mark.parametrize(
    "system",
    [
        np.zeros(9),
        np.array([1.0, 0, 0, 0, 0, 1, 1, 1, 1]),
        np.array([1.0, 0, 0, 1, 0, 0, 1, 1, 1]),
        np.array([1.0, 1, 0, 1, 0, 1, 1, 1, 1]),
        np.full(9, np.nan),
    ],
)
def test_equations_without_a_solution_are_refused(system):
    assert not solve_3x3(system, 0.0, np.zeros(3))


RESOLUTION, WALL_BLUR = 0.05, 0.1
ROOM = (3.0, 2.0)  # half its length and width [m]
TRUSTED = 1e6
TOLERANCE = 1e-5
NO_PRIOR = np.array([1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-6])


def map_of(distance):
    """A map of walls and its origin: probable near the walls, smooth; all known."""
    cols, rows = (round((half + 0.6) / RESOLUTION) for half in ROOM)
    x, y = np.meshgrid(np.arange(-cols, cols + 1), np.arange(-rows, rows + 1))
    d = distance(x * RESOLUTION, y * RESOLUTION)
    grid = 0.1 + 0.8 * np.exp(-0.5 * (d / WALL_BLUR) ** 2)
    return grid.astype(np.float32), -cols * RESOLUTION, -rows * RESOLUTION


def room():
    """A rectangular room: its map, and points on its walls in the map's frame."""
    grid_and_origin = map_of(
        lambda x, y: np.minimum(np.abs(np.abs(x) - ROOM[0]), np.abs(np.abs(y) - ROOM[1]))
    )
    along_x, along_y = np.linspace(-2.7, 2.7, 37), np.linspace(-1.7, 1.7, 25)
    walls = [(x, side * ROOM[1]) for x in along_x for side in (-1, 1)]
    walls += [(side * ROOM[0], y) for y in along_y for side in (-1, 1)]
    return grid_and_origin, np.array(walls)


def corridor():
    """Two walls along x without an end: their map, and points on them."""
    grid_and_origin = map_of(lambda x, y: np.abs(np.abs(y) - ROOM[1]))
    walls = [(x, side * ROOM[1]) for x in np.linspace(-2.0, 2.0, 41) for side in (-1, 1)]
    return grid_and_origin, np.array(walls)


def seen_from(pose, points):
    """Points of the map's frame in the frame of a scan at `pose`."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    shifted = points - pose[:2]
    return np.column_stack(
        (cos * shifted[:, 0] + sin * shifted[:, 1], cos * shifted[:, 1] - sin * shifted[:, 0])
    )


def run(
    map_and_origin,
    points,
    start,
    prior,
    information=NO_PRIOR,
    weight=1.0,
    iterations=200,
    prior_scale=TRUSTED,
    max_start_squares=math.inf,
):
    grid, origin_x, origin_y = map_and_origin
    found = np.full(11, np.nan)
    count = match_least_squares(
        SmoothMap(grid, origin_x, origin_y, RESOLUTION),
        UNKNOWN,
        points,
        np.array(start, dtype=np.float64),
        MotionPrior(
            np.array(prior, dtype=np.float64),
            np.array(information, dtype=np.float64),
            prior_scale,
        ),
        MatchOptions(weight, iterations, TOLERANCE),
        max_start_squares,
        found,
    )
    return found, count


def total_cost(map_and_origin, points, pose, prior, information, weight, prior_scale=TRUSTED):
    grid, *origin = map_and_origin
    errors = naive_errors(grid, UNKNOWN, origin, RESOLUTION, points, pose)
    xx, xy, xt, yy, yt, tt = information
    full = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
    off = np.subtract(pose, prior)
    prior_cost = prior_scale**2 * math.log1p(off @ full @ off / prior_scale**2)
    return weight * errors @ errors + prior_cost


def random_information(rng):
    factor = rng.normal(size=(3, 3)) * 3.0
    return (factor.T @ factor + np.eye(3))[np.triu_indices(3)]


def test_displacements_in_a_room_are_found_below_a_pixel():
    grid, walls = room()
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(20):
        truth = rng.uniform((-0.3, -0.3, -0.5), (0.3, 0.3, 0.5))
        start = truth + rng.uniform((-0.08, -0.08, -0.02), (0.08, 0.08, 0.02))
        measured = seen_from(truth, walls) + rng.normal(scale=0.02, size=walls.shape)
        found, _ = run(grid, measured, start, start)
        errors.append(np.abs(found[:3] - truth))
    assert (np.max(errors, axis=0) < (0.3 * RESOLUTION, 0.3 * RESOLUTION, 5e-3)).all()
    assert (np.median(errors, axis=0) < (0.1 * RESOLUTION, 0.1 * RESOLUTION, 2e-3)).all()


@settings(deadline=None, max_examples=25)
@given(seed=seeds, iterations=st.integers(1, 12), scale=st.sampled_from((0.5, 2.0, 10.0, TRUSTED)))
def test_the_cost_never_ends_higher_than_it_began(seed, iterations, scale):
    rng = np.random.default_rng(seed)
    grid = (random_grid(seed, (40, 50)), -1.25, -1.0)
    points = rng.uniform(-1.5, 1.5, (15, 2))
    start, prior = rng.uniform(-0.5, 0.5, (2, 3))
    information, weight = random_information(rng), rng.uniform(0.1, 100.0)

    found, count = run(grid, points, start, prior, information, weight, iterations, scale)

    began = total_cost(grid, points, start, prior, information, weight, scale)
    ended = total_cost(grid, points, found[:3], prior, information, weight, scale)
    assert ended <= began * (1.0 + 1e-12)
    assert found[10] == pytest.approx(ended)
    assert 1 <= count <= iterations


@pytest.mark.parametrize("seed", range(6))
def test_the_minimum_equals_that_of_a_general_solver(seed):
    rng = np.random.default_rng(seed)
    grid, walls = room()
    truth = rng.uniform(-0.2, 0.2, 3)
    points = seen_from(truth, walls[::3]) + rng.normal(scale=0.01, size=(len(walls[::3]), 2))
    start = truth + rng.uniform(-0.04, 0.04, 3)
    prior = truth + rng.uniform(-0.05, 0.05, 3)
    information, weight = random_information(rng), 2.0
    root = np.zeros((3, 3))
    root[np.triu_indices(3)] = information
    root = np.linalg.cholesky(root + np.triu(root, 1).T).T

    def residuals(pose):
        errors = naive_errors(grid[0], UNKNOWN, grid[1:], RESOLUTION, points, pose)
        return np.append(math.sqrt(weight) * errors, root @ (pose - prior))

    expected = least_squares(residuals, start, xtol=1e-10, ftol=1e-12, gtol=1e-10)
    found, _ = run(grid, points, start, prior, information, weight)

    assert found[10] == pytest.approx(2.0 * expected.cost, rel=5e-3)
    assert found[10] >= 2.0 * expected.cost * (1.0 - 1e-6)
    assert found[:2] == pytest.approx(expected.x[:2], abs=5e-3)
    assert found[2] == pytest.approx(expected.x[2], abs=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_minimum_equals_a_general_solver_with_robust_prior(seed):
    rng = np.random.default_rng(seed)
    grid, walls = room()
    truth = rng.uniform(-0.2, 0.2, 3)
    points = seen_from(truth, walls[::3]) + rng.normal(scale=0.01, size=(len(walls[::3]), 2))
    start, prior = truth + rng.uniform(-0.03, 0.03, 3), truth + rng.uniform(-0.05, 0.05, 3)
    information, weight, scale = (1e4, 0.0, 0.0, 1e4, 0.0, 1e4), 2.0, 2.0

    def cost(pose):
        return total_cost(grid, points, pose, prior, information, weight, scale)

    expected = minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9})
    found, _ = run(grid, points, start, prior, information, weight, prior_scale=scale)

    assert found[10] == pytest.approx(expected.fun, rel=5e-3)
    assert found[:2] == pytest.approx(expected.x[:2], abs=5e-3)
    assert found[2] == pytest.approx(expected.x[2], abs=1e-3)


def test_robust_loss_releases_a_wrong_prediction():
    grid, walls = room()
    rng = np.random.default_rng(3)
    points = walls + rng.normal(scale=0.01, size=walls.shape)
    wrong, information = (0.5, -0.4, 0.0), (1e4, 0.0, 0.0, 1e4, 0.0, 1e4)
    held, _ = run(grid, points, (0.0, 0.0, 0.0), wrong, information, weight=5.0)
    released, _ = run(
        grid, points, (0.0, 0.0, 0.0), wrong, information, weight=5.0, prior_scale=2.0
    )
    assert math.hypot(*held[:2]) > 0.2
    assert math.hypot(*released[:2]) < 0.02


def test_prior_holds_along_a_corridor_and_walls_across():
    grid, walls = corridor()
    points = seen_from((0.3, 0.07, 0.02), walls)
    prior = (0.5, 0.0, 0.0)
    found, _ = run(grid, points, prior, prior, (1.0, 0.0, 0.0, 1.0, 0.0, 1.0), weight=10.0)
    assert found[0] == pytest.approx(prior[0], abs=5e-3)
    assert found[1] == pytest.approx(0.07, abs=5e-3)
    assert found[2] == pytest.approx(0.02, abs=2e-3)


def test_a_strong_prior_outweighs_the_points():
    grid, walls = room()
    prior = (0.05, -0.05, 0.02)
    found, _ = run(grid, walls, (0.0, 0.0, 0.0), prior, (1e8, 0.0, 0.0, 1e8, 0.0, 1e8))
    assert found[:3] == pytest.approx(prior, abs=1e-4)


def test_in_an_unknown_map_the_prior_is_the_match():
    grid = (np.zeros((10, 10), dtype=np.float32), 0.0, 0.0)
    prior = (0.2, 0.1, 0.3)
    found, _ = run(grid, np.ones((5, 2)), (0.0, 0.0, 0.0), prior, (1e2, 0, 0, 1e2, 0, 1e2))
    assert found[:3] == pytest.approx(prior, abs=1e-2)
    assert found[3:9] == pytest.approx(np.zeros(6))


def test_match_has_curvature_and_squares_at_its_pose():
    grid, walls = room()
    found, _ = run(grid, walls, (0.03, 0.02, 0.01), (0.0, 0.0, 0.0), weight=5.0)
    system = np.empty(9)
    total = accumulate_match(
        SmoothMap(*grid, RESOLUTION),
        UNKNOWN,
        walls,
        np.zeros((2, len(walls))),
        *found[:3].tolist(),
        point_scratch(len(walls)),
        system,
    )
    assert found[3:9].tolist() == system[:6].tolist()
    assert found[9] == total


def test_one_iteration_looks_at_the_start_only():
    grid, walls = room()
    found, count = run(grid, walls, (0.03, 0.02, 0.01), (0.0, 0.0, 0.0), iterations=1)
    assert count == 1
    assert found[:3].tolist() == [0.03, 0.02, 0.01]


def test_a_scan_that_fits_too_poorly_at_the_start_is_left_there():
    grid, walls = room()
    start = (0.03, 0.02, 0.01)
    found, _ = run(grid, walls, start, (0.0, 0.0, 0.0), iterations=1)
    squares = found[9]
    kept, _ = run(grid, walls, start, (0.0, 0.0, 0.0), iterations=1, max_start_squares=squares)
    left, count = run(
        grid, walls, start, (0.0, 0.0, 0.0), max_start_squares=np.nextafter(squares, 0.0)
    )
    assert kept.tolist() == found.tolist()
    assert count == 1
    assert left[:3].tolist() == list(start)
    assert left[3:9].tolist() == [0.0] * 6
    assert np.isinf(left[9:]).all()


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (0.0, 0.03, 0.02)])
def test_walls_beyond_what_is_mapped_do_not_attract_scans(side, start):
    (grid, *origin), _ = corridor()
    grid = grid.copy()
    grid[:, side * (origin[0] + RESOLUTION * np.arange(grid.shape[1])) > 1.0] = 0.0
    along = np.arange(-2.0, 2.0, 0.05)
    points = np.concatenate([np.stack((along, np.full(80, y)), -1) for y in (-ROOM[1], ROOM[1])])
    odometry = (1e4, 0.0, 0.0, 1e4, 0.0, 1e2)
    found, _ = run((grid, *origin), points, start, (0.0, 0.0, 0.0), odometry, weight=250.0)
    assert found[0] == pytest.approx(0.0, abs=0.01)
    assert found[1:3] == pytest.approx(0.0, abs=0.01)
