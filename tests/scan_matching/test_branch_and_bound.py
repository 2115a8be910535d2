# SPDX-License-Identifier: Apache-2.0
"""Branch and bound finds what the naive search finds, and bounds are bounds."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.node_bounds import (
    HEIGHT,
    LEVEL,
    Children,
    PlacedScan,
    Places,
    place_points,
    score_children,
)
from cartoloop.kernels.search_tree import grow_tree
from cartoloop.kernels.search_window import (
    ScanExtent,
    SearchFrame,
    SearchWindow,
    rotation_step,
    scan_extent,
)
from cartoloop.scan_matching.branch_and_bound import (
    NO_RUNNER_UP,
    RunnerUp,
    SubmapMatcher,
)
from cartoloop.scan_matching.precomputation_grid import (
    MAP_STRIDES,
    MAX_MOVE,
    STRIDES,
    PrecomputationGrids,
)
from cartoloop.sensor.pose import Pose, transform_points
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid
from tests.reference.naive_branch_and_bound import (
    angular_step,
    naive_best,
    naive_runner_up,
    naive_sums,
    num_steps,
    score,
)

RESOLUTION = 0.05


def random_grid(rng, max_side=40, density=0.2):
    """Walls in mostly free or unknown space."""
    cells = rng.integers(0, 60, rng.integers(1, max_side + 1, 2)).astype(np.uint8)
    walls = rng.random(cells.shape) < density
    cells[walls] = rng.integers(150, 256, int(walls.sum()))
    cells[rng.random(cells.shape) < 0.3] = 0
    return FinishedGrid(cells, float(rng.normal()), float(rng.normal()), RESOLUTION)


def random_scan(rng, max_points=40):
    """Points near and far, so that neighbouring rotations move them very differently."""
    distances = rng.exponential(0.8, rng.integers(1, max_points + 1))
    angles = rng.uniform(-math.pi, math.pi, len(distances))
    return np.column_stack((distances * np.cos(angles), distances * np.sin(angles)))


def room():
    """A room of 6 m x 4 m with a pillar, seen from within: unmistakable."""
    cells = np.full((90, 130), 20, dtype=np.uint8)
    cells[5, 5:125] = cells[85, 5:125] = 250
    cells[5:86, 5] = cells[5:86, 124] = 250
    cells[30:38, 80:84] = 250
    rows, cols = np.nonzero(cells == 250)
    walls = np.column_stack((cols, rows))[::7] * RESOLUTION
    return FinishedGrid(cells, 0.0, 0.0, RESOLUTION), walls.astype(np.float64)


def scan_from(walls, pose):
    """The walls as seen from a pose."""
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    centred = walls - np.array((pose.x, pose.y))
    return centred @ np.array(((cos, -sin), (sin, cos)))


def step_of(max_range):
    return rotation_step(max_range, RESOLUTION, 0.5 * RESOLUTION)


def in_cells(extent):
    return ScanExtent(extent.mean / RESOLUTION, extent.farthest / RESOLUTION)


def tree_for(grids, window, step, extent):
    """The properties of the nodes of each height, and which grids bound them."""
    heights = np.zeros(len(STRIDES) + 1, dtype=HEIGHT)
    boxes = np.zeros((len(STRIDES) + 1, grids.boxes.shape[1]), dtype=np.int32)
    num_heights = grow_tree(
        grids.levels, grids.boxes, window, step, extent, MAX_MOVE, heights, boxes
    )
    return heights[:num_heights], boxes[:num_heights]


def naive_window(grid, points, estimate, linear_window, angular_window, max_range=math.inf):
    step = step_of(min(scan_extent(points).farthest, max_range))
    half_width = num_steps(linear_window, RESOLUTION)
    half_turns = num_steps(angular_window, step)
    origin = (grid.origin_x, grid.origin_y)
    sums = naive_sums(
        grid.cells, origin, RESOLUTION, points, estimate, half_width, half_width, half_turns, step
    )
    return sums, step


def assert_same_as_naive(
    grid, points, estimate, linear_window, angular_window, min_score, gap=0.0, **options
):
    """Compare with exhaustive search; a runner-up may be worse than `min_score` by `gap`."""
    least = min_score - gap
    runner_up = RunnerUp(distance=0.15, angle=0.1, min_score=least if gap else None)
    match = SubmapMatcher(grid).match(
        points,
        estimate,
        linear_window=linear_window,
        angular_window=angular_window,
        min_score=min_score,
        runner_up=runner_up,
        **options,
    )
    sums, step = naive_window(grid, points, estimate, linear_window, angular_window, **options)
    best = naive_best(sums)
    best_score = score(sums[best], len(points))
    if best_score < min_score - 1e-9:
        assert match is None
        return
    assert match is not None
    assert match.score == pytest.approx(best_score, abs=1e-12)
    dx, dy, turn = best
    assert match.tf_submap_scan.x == estimate.x + dx * RESOLUTION
    assert match.tf_submap_scan.y == estimate.y + dy * RESOLUTION
    assert math.remainder(match.tf_submap_scan.theta - estimate.theta - turn * step, math.tau) == (
        pytest.approx(0.0, abs=1e-12)
    )
    second = naive_runner_up(sums, best, RESOLUTION, step, runner_up.distance, runner_up.angle)
    second_score = score(second, len(points)) if second >= 0 else 0.0
    expected = second_score if second_score >= least - 1e-9 else 0.0
    assert match.runner_up == pytest.approx(expected, abs=1e-12)


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    linear_window=st.sampled_from((0.0, 0.04, 0.05, 0.2, 0.35)),
    angular_window=st.sampled_from((0.0, 0.03, 0.2, 0.5)),
    min_score=st.sampled_from((0.0, 0.2, 0.35, 0.5, 0.9)),
    gap=st.sampled_from((0.0, 0.05, 0.3)),
)
def test_equals_exhaustive_search(seed, linear_window, angular_window, min_score, gap):
    rng = np.random.default_rng(seed)
    grid, points = random_grid(rng), random_scan(rng)
    estimate = Pose(
        grid.origin_x + rng.uniform(-0.5, 2.5),
        grid.origin_y + rng.uniform(-0.5, 2.5),
        rng.uniform(-3, 3),
    )
    assert_same_as_naive(grid, points, estimate, linear_window, angular_window, min_score, gap)


@pytest.mark.parametrize("seed", range(3))
def test_equals_exhaustive_search_in_windows_of_all_heights(seed):
    rng = np.random.default_rng(seed)
    grid, points = random_grid(rng, max_side=60, density=0.05), random_scan(rng, max_points=12)
    estimate = Pose(grid.origin_x + 1.0, grid.origin_y + 1.0, rng.uniform(-3, 3))
    assert_same_as_naive(grid, points, estimate, 2.5, 0.15, 0.3)


def test_equals_exhaustive_search_with_more_points_than_a_block():
    rng = np.random.default_rng(7)
    grid = random_grid(rng)
    points = np.concatenate([random_scan(rng, 300) for _ in range(3)])
    estimate = Pose(grid.origin_x + 0.5, grid.origin_y + 0.7, 0.3)
    assert_same_as_naive(grid, points, estimate, 0.2, 0.05, 0.1)


@pytest.mark.parametrize("seed", range(8))
def test_equals_exhaustive_search_where_far_points_leap(seed):
    rng = np.random.default_rng(100 + seed)
    grid, points = random_grid(rng), random_scan(rng)
    estimate = Pose(grid.origin_x + 0.5, grid.origin_y + 0.5, 1.0)
    assert_same_as_naive(grid, points, estimate, 0.3, 1.0, 0.2, max_range=0.3)


@pytest.mark.parametrize("spread", [0.0, 0.01, 0.03, 0.1])
def test_scans_as_small_as_a_pixel_match_at_all_rotations(spread):
    rng = np.random.default_rng(3)
    grid, points = random_grid(rng), rng.normal(0.0, 1.0, (9, 2)) * spread
    assert_same_as_naive(
        grid, points, Pose(grid.origin_x + 0.3, grid.origin_y + 0.3, 0.0), 0.4, math.pi, 0.1
    )


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), half_turns=st.integers(0, 40))
def test_every_node_bounds_its_leaves(seed, half_turns):
    rng = np.random.default_rng(seed)
    grid, points = random_grid(rng), random_scan(rng)
    extent = scan_extent(points)
    step = step_of(extent.farthest)
    estimate = Pose(grid.origin_x + rng.uniform(-1, 3), grid.origin_y + rng.uniform(-1, 3), 0.7)
    grids = PrecomputationGrids(grid.cells)
    window = SearchWindow(40, 40, half_turns)
    heights, boxes = tree_for(grids, window, step, in_cells(extent))
    frame = SearchFrame(*estimate, grid.origin_x, grid.origin_y, RESOLUTION, step)
    places = Places(*np.zeros((3, 64), dtype=np.int32))
    scan = PlacedScan(len(points), points, frame, boxes, places)

    def sums_of(height, group, col, row):
        place_points(heights, scan, window, height, group, 0)
        sums = np.zeros((1, 4), dtype=np.int64)
        indices = np.zeros(64, dtype=np.int32)
        nodes = np.zeros((1, 16), dtype=np.int64)
        children = Children(0, height, col, row, int(heights[height]["block"]))
        score_children(
            grids.cells, heights, *places, 0, len(points), children, -1, nodes, indices, sums
        )
        return sums[0]

    for height in range(1, len(heights)):
        block, size = int(heights[height]["block"]), int(heights[height]["group"])
        group = int(rng.integers(0, 2 * half_turns // size + 1))
        col, row = (int(value) for value in rng.integers(-40, 40, 2))
        bounds = sums_of(height, group, col, row)
        for _ in range(20):
            child = int(rng.integers(4))
            rotation = min(group * size + int(rng.integers(size)), 2 * half_turns)
            x = col + block * (child & 1) + int(rng.integers(block))
            y = row + block * (child >> 1) + int(rng.integers(block))
            assert sums_of(0, rotation, x, y)[0] <= bounds[child]


def test_the_rotation_step_is_that_of_the_paper():
    points = np.array(((3.0, 4.0), (0.1, 0.0)))
    assert step_of(5.0) == pytest.approx(angular_step(points, RESOLUTION), rel=1e-12)
    # A point at the maximum range moves by a cell.
    assert 2.0 * 5.0 * math.sin(step_of(5.0) / 2.0) == pytest.approx(RESOLUTION)


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    half_turns=st.integers(0, 40),
    far=st.sampled_from((0.02, 0.8, 5.0, 30.0)),
)
def test_no_point_leaves_its_box_while_a_group_turns(seed, half_turns, far):
    rng = np.random.default_rng(seed)
    points = random_scan(rng) * far
    # Points along the axes, too: there arcs bulge beyond both of their ends.
    points = np.concatenate((points, far * np.array(((1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)))))
    extent = scan_extent(points)
    step = step_of(extent.farthest)
    grids = PrecomputationGrids(np.zeros((5, 7), dtype=np.uint8))
    window = SearchWindow(40, 40, half_turns)
    heights, boxes = tree_for(grids, window, step, in_cells(extent))
    # By how many cells points move, in place of the grid that is large enough for that.
    moves = np.tile(np.arange(boxes.shape[1], dtype=np.int32), (len(heights), 1))
    frame = SearchFrame(*rng.uniform(-3, 3, 5).tolist(), RESOLUTION, step)

    def place(height, group):
        places = np.zeros((3, len(points)), dtype=np.int32)
        scan = PlacedScan(len(points), points, frame, moves, Places(*places))
        place_points(heights, scan, window, height, group, 0)
        return places

    for height in range(1, len(heights)):
        block, size = int(heights[height]["block"]), int(heights[height]["group"])
        group = int(rng.integers(0, 2 * half_turns // size + 1))
        first_cols, first_rows, moved = place(height, group)
        assert moved.max() <= MAX_MOVE * block + 2
        for rotation in range(group * size, min((group + 1) * size, 2 * half_turns + 1)):
            cols, rows, _ = place(0, rotation)
            assert ((cols >= first_cols) & (cols <= first_cols + moved)).all()
            assert ((rows >= first_rows) & (rows <= first_rows + moved)).all()


def test_probabilities_are_the_same_with_and_without_grids():
    grid, walls = room()
    matcher = SubmapMatcher(grid)
    unpacked = matcher.probabilities()
    matcher.match(walls, Pose(0.0, 0.0, 0.0), linear_window=0.1, angular_window=0.1, min_score=1.0)
    assert matcher.memory_bytes > 0
    np.testing.assert_array_equal(matcher.probabilities(), unpacked)
    np.testing.assert_array_equal(unpacked, grid.probabilities())


def test_tree_grows_with_the_window():
    grids = PrecomputationGrids(np.zeros((5, 7), dtype=np.uint8))
    extent = ScanExtent(120.0, 300.0)
    small, _ = tree_for(grids, SearchWindow(10, 10, 40), 0.003, extent)
    large, boxes = tree_for(grids, SearchWindow(140, 140, 200), 0.003, extent)
    assert len(small) < len(large)
    assert (large[0]["block"], large[0]["group"]) == (1, 1)
    assert (np.diff(large["block"]) >= 0).all()
    assert (np.diff(large["group"]) >= 0).all()
    # The top is of the largest blocks, bounded by the grids made for them.
    assert large[-1]["block"] == 1 << (len(STRIDES) - 1)
    assert [large[-1][name] for name in LEVEL.names] == list(grids.levels[-1].tolist())
    assert boxes[-1].tolist() == grids.boxes[-1].tolist()


def test_finds_the_pose_in_a_large_window():
    grid, walls = room()
    truth = Pose(2.4, 1.9, 0.4)
    points = scan_from(walls, truth)
    np.testing.assert_allclose(transform_points(truth, points), walls, atol=1e-12)
    match = SubmapMatcher(grid).match(
        points, Pose(5.0, -1.0, 0.0), linear_window=7.0, angular_window=0.6, min_score=0.55
    )
    assert match is not None
    assert math.hypot(match.tf_submap_scan.x - truth.x, match.tf_submap_scan.y - truth.y) < 0.06
    assert abs(match.tf_submap_scan.theta - truth.theta) < 0.02
    assert match.score > match.runner_up


def test_finds_the_pose_from_nowhere():
    grid, walls = room()
    truth = Pose(1.4, 2.9, -2.7)
    match = SubmapMatcher(grid).match_full_submap(scan_from(walls, truth), min_score=0.6)
    assert match is not None
    assert math.hypot(match.tf_submap_scan.x - truth.x, match.tf_submap_scan.y - truth.y) < 0.06
    assert abs(match.tf_submap_scan.theta - truth.theta) < 0.02
    assert match.runner_up == 0.0


def test_a_score_that_just_reaches_the_threshold_is_enough():
    cells = np.full((30, 30), 128, dtype=np.uint8)
    matcher = SubmapMatcher(FinishedGrid(cells, 0.0, 0.0, RESOLUTION))
    points = np.array(((0.1, 0.0), (0.0, 0.2), (0.3, 0.1)))
    here = {"linear_window": 0.1, "angular_window": 0.1}
    reached = score(3 * 128, 3)
    assert matcher.match(points, Pose(0.7, 0.7, 0.0), min_score=reached, **here) is not None
    assert matcher.match(points, Pose(0.7, 0.7, 0.0), min_score=reached + 1e-3, **here) is None


def test_of_equal_scores_the_estimate_itself_wins():
    cells = np.full((200, 200), 200, dtype=np.uint8)
    estimate = Pose(5.0, 5.0, 0.3)
    match = SubmapMatcher(FinishedGrid(cells, 0.0, 0.0, RESOLUTION)).match(
        random_scan(np.random.default_rng(1)),
        estimate,
        linear_window=3.0,
        angular_window=0.5,
        min_score=0.3,
    )
    assert match is not None
    assert match.tf_submap_scan == estimate
    assert match.runner_up == match.score


def test_runner_up_is_searched_for_within_the_margin():
    rng = np.random.default_rng(5)
    grid, points = random_grid(rng), random_scan(rng)
    estimate = Pose(grid.origin_x + 0.5, grid.origin_y + 0.5, 0.0)
    window = {"linear_window": 0.4, "angular_window": 0.2, "min_score": 0.1}
    matcher = SubmapMatcher(grid)
    exact = matcher.match(points, estimate, **window)
    assert exact is not None
    assert 0.0 < exact.runner_up < exact.score
    gap = exact.score - exact.runner_up
    near = matcher.match(points, estimate, runner_up=RunnerUp(margin=1.01 * gap), **window)
    assert near == exact
    for options in (RunnerUp(margin=0.99 * gap), NO_RUNNER_UP):
        without = matcher.match(points, estimate, runner_up=options, **window)
        assert without is not None
        assert (without.tf_submap_scan, without.score) == (exact.tf_submap_scan, exact.score)
        assert without.runner_up == 0.0


@pytest.mark.parametrize("x", [-1e4, -40.0, 40.0, 1e4])
def test_a_scan_far_outside_matches_nothing(x):
    grid, walls = room()
    match = SubmapMatcher(grid).match(
        walls, Pose(x, x, 0.0), linear_window=1.0, angular_window=0.1, min_score=0.2
    )
    assert match is None


def test_a_scan_without_points_matches_nothing():
    grid, _ = room()
    match = SubmapMatcher(grid).match(
        np.zeros((0, 2)), Pose(1.0, 1.0, 0.0), linear_window=1.0, angular_window=0.1, min_score=0.0
    )
    assert match is None


@pytest.mark.parametrize("shape", [(0, 0), (0, 7), (3, 0)])
def test_nothing_matches_an_empty_submap(shape):
    matcher = SubmapMatcher(FinishedGrid(np.zeros(shape, dtype=np.uint8), 0.0, 0.0, RESOLUTION))
    points = np.ones((5, 2))
    here = Pose(0.0, 0.0, 0.0)
    assert matcher.match(points, here, linear_window=1.0, angular_window=0.1, min_score=0.0) is None
    assert matcher.match_full_submap(points, min_score=0.0) is None


def test_two_threads_find_the_same():
    rng = np.random.default_rng(9)
    grid, walls = room()
    matcher = SubmapMatcher(grid)
    truths = [Pose(*rng.uniform((1, 1, -0.5), (5, 3, 0.5))) for _ in range(24)]

    def find(truth):
        return matcher.match(
            scan_from(walls, truth),
            Pose(3.0, 2.0, 0.0),
            linear_window=3.0,
            angular_window=0.6,
            min_score=0.5,
        )

    alone = [find(truth) for truth in truths]
    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(find, truths)) == alone
    assert None not in alone


def test_memory_is_that_of_the_grids_until_released():
    grid, walls = room()
    matcher = SubmapMatcher(grid)
    truth = Pose(2.4, 1.9, 0.4)

    def find():
        return matcher.match(
            scan_from(walls, truth), truth, linear_window=0.5, angular_window=0.1, min_score=0.5
        )

    assert matcher.memory_bytes == 0
    first = find()
    assert first is not None
    assert matcher.memory_bytes == PrecomputationGrids(grid.cells).cells.nbytes
    matcher.release()
    assert matcher.memory_bytes == 0
    assert find() == first
    assert matcher.memory_bytes > 0


def test_grids_may_be_released_while_threads_search():
    grid, walls = room()
    matcher = SubmapMatcher(grid)
    points, estimate = scan_from(walls, Pose(2.4, 1.9, 0.4)), Pose(2.3, 2.0, 0.4)

    def find(number):
        if number % 3 == 0:
            matcher.release()
        return matcher.match(points, estimate, linear_window=0.5, angular_window=0.1, min_score=0.5)

    alone = find(1)
    assert alone is not None
    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(find, range(30))) == [alone] * 30


def many_scans(seed, count):
    rng = np.random.default_rng(seed)
    grid = random_grid(rng)
    clouds = [rng.uniform(-0.8, 0.8, (int(rng.integers(1, 60)), 2)) for _ in range(count)]
    estimates = rng.uniform(-0.5, 1.5, (count, 3))
    linear, angular = rng.uniform(0.0, 0.5, count), rng.uniform(0.0, 0.4, count)
    return grid, clouds, estimates, linear, angular


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), min_score=st.floats(0.1, 0.6))
def test_many_scans_at_once_are_found_where_each_is_found_alone(seed, min_score):
    grid, clouds, estimates, linear, angular = many_scans(seed, 6)
    matcher = SubmapMatcher(grid)

    found = matcher.match_all(
        ScanPoints.of(clouds), estimates, linear_windows=linear, angular_windows=angular,
        min_score=min_score, groups=np.arange(6), max_of_group=1,
    )  # fmt: skip

    assert found.was_searched.all()
    for i, points in enumerate(clouds):
        alone = matcher.match(
            points, Pose(*estimates[i].tolist()), linear_window=float(linear[i]),
            angular_window=float(angular[i]), min_score=min_score,
        )  # fmt: skip
        assert found.matches[i] == alone


@pytest.mark.parametrize("max_of_group", [1, 2, 5])
def test_group_is_skipped_once_enough_are_found(max_of_group):
    grid, clouds, estimates, linear, angular = many_scans(1, 9)
    groups = np.array((0, 1, 0, 1, 0, 1, 0, 1, 0))

    found = SubmapMatcher(grid).match_all(
        ScanPoints.of(clouds), estimates, linear_windows=linear, angular_windows=angular,
        min_score=0.0, groups=groups, max_of_group=max_of_group,
    )  # fmt: skip

    for group, size in ((0, 5), (1, 4)):
        expected = [True] * min(max_of_group, size) + [False] * max(size - max_of_group, 0)
        assert found.was_searched[groups == group].tolist() == expected
    assert [match is not None for match in found.matches] == found.was_searched.tolist()


@pytest.mark.parametrize(("max_expanded", "are_found"), [(1_000_000, True), (1, False)])
def test_a_search_that_takes_too_long_finds_nothing(max_expanded, are_found):
    grid, clouds, estimates, linear, angular = many_scans(1, 4)
    found = SubmapMatcher(grid).match_all(
        ScanPoints.of(clouds), estimates, linear_windows=linear + 0.3, angular_windows=angular,
        min_score=0.0, groups=np.arange(4), max_of_group=1, max_expanded=max_expanded,
    )  # fmt: skip
    assert found.was_searched.all()
    assert [match is not None for match in found.matches] == [are_found] * 4


def test_nothing_is_found_for_no_scans():
    grid, *_ = many_scans(2, 1)
    none = np.zeros(0)
    found = SubmapMatcher(grid).match_all(
        ScanPoints.of([]), np.zeros((0, 3)), linear_windows=none, angular_windows=none,
        min_score=0.5, groups=np.zeros(0, dtype=np.int64), max_of_group=1,
    )  # fmt: skip
    assert found.matches == []
    assert len(found.was_searched) == 0


def test_larger_blocks_find_the_same_in_a_large_map():
    rng = np.random.default_rng(3)
    cells = np.zeros((700, 900), dtype=np.uint8)
    for _ in range(60):
        row, col = rng.integers(0, 600), rng.integers(0, 800)
        height, width = rng.integers(1, 90, 2)
        cells[row : row + height, col : col + width] = 20
        cells[row, col : col + width] = cells[row : row + height, col] = 250
    grid = FinishedGrid(cells, -3.0, 2.0, RESOLUTION)
    rows, cols = np.nonzero(cells == 250)
    walls = (np.column_stack((cols, rows)) * RESOLUTION + (-3.0, 2.0))[:300:4]
    scan = scan_from(walls, Pose(4.0, 6.0, 0.8))
    tops = []

    found = []
    for strides in (STRIDES, MAP_STRIDES):
        matcher = SubmapMatcher(grid, strides)
        found.append(matcher.match_full_submap(scan, min_score=0.5, runner_up=RunnerUp()))
        tops.append(PrecomputationGrids(cells, strides).levels[-1]["shift"])

    assert found[0] is not None
    assert found[0] == found[1]
    assert tops[1] > tops[0]
