# SPDX-License-Identifier: Apache-2.0
"""The figures of searches: how long they take, what they score, what they find."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from cartoloop.benchmarks.bounding_grids import BoundingGrids
from cartoloop.benchmarks.matching_programs import (
    Found,
    Problem,
    Window,
    branch_and_bound,
    check_same,
    count_nodes,
    exhaustive_by_rows,
    plain_branch_and_bound,
)
from cartoloop.benchmarks.measuring import alternate
from cartoloop.benchmarks.record import Figure

SAMPLE_S = 0.002
"""Searches are timed in loops of at least so long [s]."""

PLAIN_REPEATS = 3
"""At most so many searches are timed of those that take long enough for the clock."""


def search_figures(
    problems: Sequence[Problem], repeats: int, num_counted: int, num_checked: int
) -> dict[str, Figure]:
    """Return the figures of branch and bound.

    Parameters
    ----------
    problems : to solve and time.
    repeats : how often each is timed.
    num_counted, num_checked : of so many of the first ones the nodes are counted; so many are also
        solved by exhaustive search.

    Raises
    ------
    CartoloopError
        Exhaustive search finds another best candidate.
    """
    matches = [branch_and_bound(problem) for problem in problems]
    seconds = [median_seconds(partial(branch_and_bound, p), repeats) for p in problems]
    counts = np.array([count_nodes(problem) for problem in problems[:num_counted]])
    scores = [match.score for match in matches if match is not None]
    figures = {
        "search": milliseconds(seconds),
        "nodes": Figure.of_samples(counts.sum(axis=1).tolist(), ""),
        "nodes at the top": Figure.of_samples(counts[:, 0].tolist(), ""),
        "candidates": Figure.of_samples([p.num_candidates for p in problems], "", None),
        "found": Figure.exact(100.0 * len(scores) / len(problems), "%", None),
    }
    if scores:
        figures["score"] = Figure.of_samples(scores, "", None)
    if num_checked:
        checked = problems[:num_checked]
        exhaustive = exhaustive_seconds(exhaustive_by_rows, checked)
        figures["exhaustive"] = milliseconds(exhaustive)
        figures["ratio"] = ratio(exhaustive, seconds[:num_checked])
    return figures


def plain_figures(
    problems: Sequence[Problem],
    make_grids: Callable[..., BoundingGrids],
    top: int,
    repeats: int,
) -> dict[str, Figure]:
    """Return the figures of the plain search with some grids as bounds.

    Raises
    ------
    CartoloopError
        It does not find what branch and bound does.
    """
    repeats = min(repeats, PLAIN_REPEATS)
    seconds, build, counts, memory = [], [], [], []
    for problem in problems:
        make = partial(make_grids, problem.grid.cells, top)
        grids = make()
        found, nodes = plain_branch_and_bound(problem, grids)
        check_same(branch_and_bound(problem), found, "the plain search")
        seconds.append(median_seconds(partial(plain_branch_and_bound, problem, grids), repeats))
        build.append(median_seconds(make, repeats))
        counts.append((int(nodes.sum()), int(nodes[top])))
        memory.append(grids.cells.nbytes / 1e6)
    return {
        "search": milliseconds(seconds),
        "nodes": Figure.of_samples([total for total, _ in counts], ""),
        "nodes at the top": Figure.of_samples([first for _, first in counts], ""),
        "build": milliseconds(build),
        "memory": Figure.of_samples(memory, "MB"),
    }


def exhaustive_seconds(
    exhaustive: Callable[[Problem], Found | None], problems: Sequence[Problem]
) -> list[float]:
    """Return how long exhaustive search takes [s], and check that it finds the same."""
    exhaustive(replace(problems[0], window=Window(0.0, 0.0)))  # compiles
    seconds = []
    for problem in problems:
        start = perf_counter()
        found = exhaustive(problem)
        seconds.append(perf_counter() - start)
        check_same(branch_and_bound(problem), found, "exhaustive search")
    return seconds


def median_seconds(program: Callable[[], object], repeats: int) -> float:
    """Return the median of what a call of a program takes [s]."""
    return float(np.median(alternate({"": program}, repeats, SAMPLE_S)[""]))


def ratio(theirs: Sequence[float], ours: Sequence[float]) -> Figure:
    """Return how many times longer other searches take than ours."""
    ratios = [their / our for their, our in zip(theirs, ours, strict=True)]
    return Figure.of_samples(ratios, "", "more")


def milliseconds(seconds: Sequence[float]) -> Figure:
    """Return the median and the spread of times [s]."""
    return Figure.of_samples([1e3 * value for value in seconds], "ms")
