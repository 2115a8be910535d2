# SPDX-License-Identifier: Apache-2.0
"""The benchmark of branch and bound, and its check for a wrong match."""

import math

import numpy as np
import pytest

from bench.matching.benchmark import Sizes, run
from bench.matching.bounding_grids import halved, precomputed
from bench.matching.programs import (
    Problem,
    Window,
    branch_and_bound,
    check_same,
    count_nodes,
    exhaustive_as_written,
    exhaustive_by_rows,
    global_problem,
    plain_branch_and_bound,
)
from cartoloop.errors import CartoloopError
from cartoloop.scan_matching.branch_and_bound import SubmapMatcher
from cartoloop.sensor.pose import Pose, inverse, transform_points
from cartoloop.submaps.finished_grid import FinishedGrid

pytestmark = pytest.mark.slow

TRUTH = Pose(2.4, 1.9, 0.4)


def room_problem(window, erased=np.s_[:, :0]):
    """A room with a pillar, seen from inside; some cells of its map are erased."""
    cells = np.full((70, 100), 20, dtype=np.uint8)
    cells[5, 5:95] = cells[65, 5:95] = cells[5:66, 5] = cells[5:66, 94] = 250
    cells[30:38, 70:74] = 250
    rows, cols = np.nonzero(cells == 250)
    walls = np.column_stack((cols, rows))[::4] * 0.05
    cells[erased] = 0
    grid = FinishedGrid(cells, 0.0, 0.0, 0.05)
    points = transform_points(inverse(TRUTH), walls)
    estimate = Pose(TRUTH.x - 0.3, TRUTH.y + 0.2, TRUTH.theta - 0.05)
    return Problem(SubmapMatcher(grid), grid, points, estimate, window)


@pytest.fixture(scope="module")
def record():
    sizes = Sizes(
        max_scans=600,
        num_pairs=2,
        num_varied=1,
        num_plain=1,
        num_checked=1,
        num_as_written=1,
        num_global_checked=0,
        linear_m=(0.5, 1.0),
        angular_deg=(5.0, 10.0),
        num_points=(50, 400),
        min_scores=(0.5, 0.7),
        tops=(3, 4),
        window=Window(1.0, math.radians(10.0)),
    )
    return run(1, None, sizes)


def test_every_part_has_rows_of_hits_and_misses(record):
    parts = {(row.case["part"], row.case.get("pairs")) for row in record.rows if row.figures}
    varied = (
        "hits and misses",
        "with exact runner-up",
        "window size",
        "window angle",
        "points",
        "threshold",
        "global search",
        "bounds",
        "tree height",
    )
    assert parts == {(part, outcome) for part in varied for outcome in ("hit", "miss")} | {
        ("precomputed grids", None)
    }
    cases = [tuple(row.case.items()) for row in record.rows]
    assert len(set(cases)) == len(cases)


def test_hits_are_found_and_misses_are_not(record):
    found = {
        row.case["pairs"]: row.figures["found"].value
        for row in record.rows
        if row.case["part"] == "hits and misses" and row.figures
    }
    assert found == {"hit": 100.0, "miss": 0.0}


def test_branch_and_bound_scores_fewer_than_exhaustive(record):
    for row in record.rows:
        if row.case["part"] == "hits and misses" and row.figures:
            assert row.figures["nodes"].value < 0.1 * row.figures["candidates"].value
            assert row.figures["ratio"].value > 1.0
            assert row.figures["ratio as written"].value > 1.0


def test_looser_bounds_score_more_nodes_in_less_memory(record):
    for outcome in ("hit", "miss"):
        rows = {
            row.case["bounds"]: row.figures
            for row in record.rows
            if row.case["part"] == "bounds" and row.case["pairs"] == outcome
        }
        exact, met, joined, own = rows.values()
        assert exact["nodes"].value <= met["nodes"].value <= joined["nodes"].value
        assert exact["memory"].value > met["memory"].value
        assert own["nodes"].value > 0


def test_missing_recordings_have_notes(record):
    missing = [row for row in record.rows if not row.figures]
    assert [row.case["source"] for row in missing] == ["mit-csail", "intel", "aces"]
    assert all("is missing" in row.notes for row in missing)
    assert {row.case["source"] for row in record.rows if row.figures} == {"simulated office"}


@pytest.mark.parametrize("window", [Window(0.6, 0.15, 0.4), Window(0.6, 0.15, 0.99)])
def test_all_programs_find_the_same(window):
    problem = room_problem(window)
    match = branch_and_bound(problem)
    assert (match is None) == (window.min_score > 0.9)
    for exhaustive in (exhaustive_as_written, exhaustive_by_rows):
        check_same(match, exhaustive(problem), "exhaustive search")
    for make_grids in (precomputed, halved):
        found, _ = plain_branch_and_bound(problem, make_grids(problem.grid.cells, 4))
        check_same(match, found, "plain search")


def test_the_global_problem_is_that_of_the_whole_submap():
    problem = global_problem(room_problem(Window(0.5, 0.1, 0.5)))
    match = branch_and_bound(problem)
    assert match is not None
    assert math.hypot(match.tf_submap_scan.x - TRUTH.x, match.tf_submap_scan.y - TRUTH.y) < 0.1
    check_same(match, exhaustive_by_rows(problem), "exhaustive search")


def test_a_match_that_differs_is_an_error():
    problem = room_problem(Window(0.6, 0.15, 0.4))
    elsewhere = room_problem(Window(0.6, 0.15, 0.4), np.s_[:, :50])
    for found in (exhaustive_by_rows(elsewhere), None):
        with pytest.raises(CartoloopError, match="must agree"):
            check_same(branch_and_bound(problem), found, "exhaustive search")


def test_counting_nodes_does_not_change_the_search():
    # No node reaches the threshold: only the nodes that cover the window are scored.
    without_match = room_problem(Window(0.6, 0.0, 1.0), np.s_[:])
    top, below = count_nodes(without_match)
    assert (top % 4, below) == (0, 0)
    assert top > 0
    top, below = count_nodes(room_problem(Window(0.6, 0.15, 0.4)))
    assert 0 < below < room_problem(Window(0.6, 0.15, 0.4)).num_candidates
