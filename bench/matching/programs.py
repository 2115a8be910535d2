# SPDX-License-Identifier: Apache-2.0
"""Other exact searches for the best match in a window, to compare branch and bound with.

All of them take a :class:`Problem`, so that they score the same candidates as
:class:`SubmapMatcher`, and return a :class:`Found` that must equal its match.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import FunctionType
from typing import Any, cast

import numpy as np

from bench.matching.bounding_grids import BoundingGrids
from bench.matching.exhaustive_search import search_as_written, search_by_rows
from bench.matching.plain_search import search_plainly
from cartoloop.arrays import ByteArray, FloatArray, IntArray
from cartoloop.errors import CartoloopError
from cartoloop.kernels import branch_and_bound as kernels
from cartoloop.kernels import search_batch
from cartoloop.kernels.node_bounds import Children, Records, score_children
from cartoloop.kernels.search_window import (
    ROUNDING,
    SearchFrame,
    SearchWindow,
    rotation_step,
    scan_extent,
)
from cartoloop.scan_matching.branch_and_bound import (
    NO_RUNNER_UP,
    BranchAndBoundMatch,
    RunnerUp,
    SubmapMatcher,
)
from cartoloop.sensor.pose import Pose, wrap_angle
from cartoloop.submaps.finished_grid import FinishedGrid, mean_probability, mean_value


@dataclass(frozen=True, slots=True)
class Window:
    """A search window, eq. (8), and the score threshold.

    Attributes
    ----------
    linear, angular : W_x = W_y [m] and W_theta [rad]; infinite W_x: anywhere in the submap, at any
        rotation.
    min_score : in [0, 1].
    """

    linear: float = 7.0
    angular: float = math.radians(30.0)
    min_score: float = 0.55


WHOLE_SUBMAP = Window(math.inf, math.pi)
"""The window of a global search."""


@dataclass(frozen=True, slots=True)
class Problem:
    """A scan to search for in a window.

    Attributes
    ----------
    matcher : branch and bound in the submap; `grid` : the submap's.
    points : float64, shape (n, 2), scan frame [m], n > 0.
    estimate : the window's centre.
    window : to search.
    """

    matcher: SubmapMatcher
    grid: FinishedGrid
    points: FloatArray
    estimate: Pose
    window: Window

    @property
    def half_widths(self) -> SearchWindow:
        """(w_x, w_y, w_theta) of eq. (8)."""
        num_rows, num_cols = self.grid.shape
        half_size = (num_cols // 2, num_rows // 2)
        if math.isfinite(self.window.linear):
            half_size = 2 * (math.ceil(self.window.linear / self.grid.resolution - ROUNDING),)
        return SearchWindow(*half_size, math.ceil(self.window.angular / self.step - ROUNDING))

    @property
    def step(self) -> float:
        """delta_theta of eq. (7) [rad]."""
        resolution = self.grid.resolution
        return rotation_step(scan_extent(self.points).farthest, resolution, 0.5 * resolution)

    @property
    def min_sum(self) -> int:
        """Sum of cell values that a match must reach."""
        return max(math.ceil(mean_value(self.window.min_score) * len(self.points) - 1e-6), 0)

    @property
    def num_candidates(self) -> int:
        """Number of poses in the window, eq. (9)."""
        return int(np.prod(2 * np.array(self.half_widths) + 1))

    @property
    def frame(self) -> SearchFrame:
        """`frame` of :func:`cartoloop.kernels.branch_and_bound.search`."""
        grid = self.grid
        return SearchFrame(*self.estimate, grid.origin_x, grid.origin_y, grid.resolution, self.step)


def global_problem(problem: Problem) -> Problem:
    """Return the problem of finding the same scan anywhere in the submap."""
    grid = problem.grid
    num_rows, num_cols = grid.shape
    centre = Pose(
        grid.origin_x + num_cols // 2 * grid.resolution,
        grid.origin_y + num_rows // 2 * grid.resolution,
        0.0,
    )
    window = replace(WHOLE_SUBMAP, min_score=problem.window.min_score)
    return replace(problem, estimate=centre, window=window)


def branch_and_bound(
    problem: Problem, runner_up: RunnerUp = NO_RUNNER_UP
) -> BranchAndBoundMatch | None:
    """Return the match of this project's matcher, by default without a runner-up."""
    window = problem.window
    if not math.isfinite(window.linear):
        return problem.matcher.match_full_submap(problem.points, min_score=window.min_score)
    return problem.matcher.match(
        problem.points,
        problem.estimate,
        linear_window=window.linear,
        angular_window=window.angular,
        min_score=window.min_score,
        runner_up=runner_up,
    )


@dataclass(frozen=True, slots=True)
class Found:
    """The best candidate of a window that reaches the threshold.

    Attributes
    ----------
    tf_submap_scan : its pose.
    score : in [0, 1].
    """

    tf_submap_scan: Pose
    score: float


def exhaustive_by_rows(problem: Problem) -> Found | None:
    """Return the best candidate of all, scored a row at once."""
    return _exhaustive(problem, search_by_rows)


def exhaustive_as_written(problem: Problem) -> Found | None:
    """Return the best candidate of all, scored one after the other as algorithm 1 does."""
    return _exhaustive(problem, search_as_written)


def _exhaustive(problem: Problem, kernel: Callable[..., None]) -> Found | None:
    best = np.empty(4, dtype=np.int64)
    kernel(problem.grid.cells, problem.points, problem.frame, problem.half_widths, best)
    return _found(problem, best)


def plain_branch_and_bound(problem: Problem, grids: BoundingGrids) -> tuple[Found | None, IntArray]:
    """Return the best candidate, and the nodes scored by height, by algorithm 3 as written."""
    best = np.empty(4, dtype=np.int64)
    counts = np.empty(len(grids.levels), dtype=np.int64)
    search_plainly(
        grids.cells,
        grids.levels,
        problem.points,
        problem.frame,
        problem.half_widths,
        problem.min_sum,
        best,
        counts,
    )
    return _found(problem, best), counts


def check_same(match: BranchAndBoundMatch | None, found: Found | None, how: str) -> None:
    """Raise unless branch and bound found what another exact search did.

    Raises
    ------
    CartoloopError
        Score or pose differ, if only in the last bit: one of the two is wrong.
    """
    ours = None if match is None else Found(match.tf_submap_scan, match.score)
    if ours != found:
        raise CartoloopError(
            f"branch and bound found {ours}, {how} {found}: they must agree; report this as a bug"
        )


def count_nodes(problem: Problem) -> tuple[int, int]:
    """Return the number of nodes that this project's matcher scores at the tree's top, and below.

    The search itself runs, line by line in the interpreter, with its innermost kernel replaced by
    one that counts: in the compiled search, where it is short, counting would cost time.
    """
    top, below = 0, 0

    def counting_score(cells: ByteArray, heights: Records, *rest: object) -> bool:
        nonlocal top, below
        children = cast(Children, rest[5])
        count = 4 if children.step > 0 else 1
        if children.height == len(heights) - 1:
            top += count
        else:
            below += count
        return score_children(cells, heights, *cast(Any, rest))

    push = _rebound(kernels.push_children, score_children=counting_score)
    counting_search = _rebound(
        kernels.search,
        cover_window=_rebound(kernels.cover_window, push_children=push),
        find_best=_rebound(kernels.find_best, push_children=push),
    )
    counting_scans = _rebound(search_batch.search_scans, search=counting_search)
    matcher_search = _rebound(SubmapMatcher._search, search_scans=counting_scans)
    counting_matcher = type("CountingMatcher", (SubmapMatcher,), {"_search": matcher_search})
    branch_and_bound(replace(problem, matcher=counting_matcher(problem.grid)))
    return top, below


def _rebound(function: Callable[..., Any], **names: object) -> Callable[..., Any]:
    """Return an uncompiled copy of a function, with some of its global names replaced."""
    plain = cast(FunctionType, getattr(function, "py_func", function))
    rebound = FunctionType(plain.__code__, {**plain.__globals__, **names}, plain.__name__)
    rebound.__kwdefaults__ = plain.__kwdefaults__
    return rebound


def _found(problem: Problem, best: IntArray) -> Found | None:
    """Return a candidate, (sum, column, row, rotation), if it reaches the threshold."""
    total, *steps = best.tolist()
    if total < problem.min_sum:
        return None
    half_widths = problem.half_widths
    col, row, rotation = (at - half for at, half in zip(steps, half_widths, strict=True))
    resolution, step = problem.grid.resolution, problem.step
    return Found(
        Pose(
            problem.estimate.x + col * resolution,
            problem.estimate.y + row * resolution,
            wrap_angle(problem.estimate.theta + rotation * step),
        ),
        mean_probability(total / len(problem.points)),
    )
