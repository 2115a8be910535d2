# SPDX-License-Identifier: Apache-2.0
"""The figures of searches: time, nodes scored, matches found."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from bench.matching.bounding_grids import BoundingGrids
from bench.matching.programs import (
    Found,
    Problem,
    Window,
    branch_and_bound,
    check_same,
    count_nodes,
    exhaustive_by_rows,
    plain_branch_and_bound,
)
from bench.measuring import alternate
from bench.record import Figure

SAMPLE_S = 0.002
"""Least duration of a timing loop [s]."""

PLAIN_REPEATS = 3
"""Most repeats of a search that is long enough to be timed by one call."""


def search_figures(
    problems: Sequence[Problem], repeats: int, num_counted: int, num_checked: int
) -> dict[str, Figure]:
    """Return the figures of branch and bound.

    Parameters
    ----------
    problems : to solve and time.
    repeats : number of timed calls of each.
    num_counted, num_checked : number of problems, from the first on, whose nodes are counted, and
        that are also solved by exhaustive search.

    Raises
    ------
    CartoloopError
        Exhaustive search finds another best candidate.
    """
    matches = [branch_and_bound(problem) for problem in problems]
    samples = [sample_seconds(partial(branch_and_bound, p), repeats) for p in problems]
    counts = np.array([count_nodes(problem) for problem in problems[:num_counted]])
    scores = [match.score for match in matches if match is not None]
    figures = {
        "search": milliseconds(samples),
        "nodes": Figure.exact_of_inputs(counts.sum(axis=1).tolist()),
        "nodes at the top": Figure.exact_of_inputs(counts[:, 0].tolist()),
        "candidates": Figure.exact_of_inputs([p.num_candidates for p in problems], "", None),
        "found": Figure.exact(100.0 * len(scores) / len(problems), "%", None),
    }
    if scores:
        figures["score"] = Figure.exact_of_inputs(scores, "", None)
    if num_checked:
        checked = problems[:num_checked]
        figures |= exhaustive_figures(exhaustive_by_rows, checked, repeats, "exhaustive", "ratio")
    return figures


def plain_figures(
    problems: Sequence[Problem],
    programs: Mapping[str, tuple[Callable[..., BoundingGrids], int]],
    repeats: int,
) -> dict[str, dict[str, Figure]]:
    """Return the figures of the plain search, by name, with the grids and heights of `programs`.

    They are timed in turn on each of the problems.

    Raises
    ------
    CartoloopError
        It does not find what branch and bound does.
    """
    repeats = min(repeats, PLAIN_REPEATS)
    seconds: dict[str, list[list[float]]] = {name: [] for name in programs}
    build: dict[str, list[list[float]]] = {name: [] for name in programs}
    counts: dict[str, list[tuple[int, int]]] = {name: [] for name in programs}
    memory: dict[str, list[float]] = {name: [] for name in programs}
    for problem in problems:
        match = branch_and_bound(problem)
        makes = {
            name: partial(make_grids, problem.grid.cells, top)
            for name, (make_grids, top) in programs.items()
        }
        searches = {}
        for name, make in makes.items():
            grids = make()
            found, nodes = plain_branch_and_bound(problem, grids)
            check_same(match, found, "the plain search")
            searches[name] = partial(plain_branch_and_bound, problem, grids)
            counts[name].append((int(nodes.sum()), int(nodes[programs[name][1]])))
            memory[name].append(grids.cells.nbytes / 1e6)
        searched = alternate(searches, repeats, SAMPLE_S)
        built = alternate(makes, repeats, SAMPLE_S)
        for name in programs:
            seconds[name].append(searched[name])
            build[name].append(built[name])
    return {
        name: {
            "search": milliseconds(seconds[name]),
            "nodes": Figure.exact_of_inputs([total for total, _ in counts[name]]),
            "nodes at the top": Figure.exact_of_inputs([first for _, first in counts[name]]),
            "build": milliseconds(build[name]),
            "memory": Figure.exact_of_inputs(memory[name], "MB"),
        }
        for name in programs
    }


def exhaustive_figures(
    exhaustive: Callable[[Problem], Found | None],
    problems: Sequence[Problem],
    repeats: int,
    name: str,
    ratio_name: str,
) -> dict[str, Figure]:
    """Return the time of exhaustive search, also as a multiple of that of branch and bound.

    It runs once on each problem, and branch and bound right after it. It must find the same.

    Raises
    ------
    CartoloopError
        It finds another best candidate.
    """
    exhaustive(replace(problems[0], window=Window(0.0, 0.0)))  # compiles
    seconds, ratios = [], []
    for problem in problems:
        start = perf_counter()
        found = exhaustive(problem)
        seconds.append([perf_counter() - start])
        check_same(branch_and_bound(problem), found, "exhaustive search")
        own = np.median(sample_seconds(partial(branch_and_bound, problem), repeats))
        ratios.append([seconds[-1][0] / float(own)])
    return {name: milliseconds(seconds), ratio_name: Figure.of_inputs(ratios, "", "more")}


def sample_seconds(program: Callable[[], object], repeats: int) -> list[float]:
    """Return the time of a call of a program in each repeat [s]."""
    return alternate({"": program}, repeats, SAMPLE_S)[""]


def milliseconds(seconds: Sequence[Sequence[float]]) -> Figure:
    """Return the median and spread over problems, given the repeats of each [s]."""
    return Figure.of_inputs([[1e3 * value for value in times] for times in seconds], "ms")
