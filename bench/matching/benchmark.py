# SPDX-License-Identifier: Apache-2.0
"""``python -m bench matching``: branch and bound against exhaustive search (section V-B)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from bench.environment import environment
from bench.matching import bounding_grids
from bench.matching.cases import Pair, Place, hits, map_places, misses
from bench.matching.figures import (
    exhaustive_figures,
    milliseconds,
    plain_figures,
    sample_seconds,
    search_figures,
)
from bench.matching.programs import (
    Problem,
    Window,
    branch_and_bound,
    exhaustive_as_written,
    global_problem,
)
from bench.record import Case, Figure, Record, Row
from cartoloop.scan_matching.branch_and_bound import RUNNER_UP
from cartoloop.scan_matching.precomputation_grid import PrecomputationGrids

PAPER_WINDOW = Window()
"""±7 m and ±30 degrees."""

HOW = (
    "all: one thread each; median and spread over different pairs, for each pair the median of its "
    "repeats; exhaustive search runs once, for the first of the pairs, and must find the same "
    "score and pose; its ratio is to a search of the same pair right after it; it reads and "
    "adds whole rows of candidates as vectors, 'as written' is algorithm 1 compiled; nodes are "
    "counted for some of the pairs"
)
HITS = "revisits; the estimate is off by up to 80 % of the window"
MISSES = "scans from elsewhere, searched for at a pose of the submap's own, turned to any heading"


@dataclass(frozen=True, slots=True)
class Sizes:
    """How much to measure.

    Attributes
    ----------
    max_scans : of each recording.
    num_pairs : hits, and misses, of each recording.
    num_varied : number of pairs where a parameter varies.
    num_plain : number of pairs for the plain search, and for counting nodes.
    num_checked, num_as_written, num_global_checked : number of pairs for exhaustive search: by
        rows, as written, and in the whole submap, the last only in the first recording.
    min_num_points : least number of points that scans are thinned to.
    linear_m, angular_deg, num_points, min_scores, tops : values to vary: W_x = W_y, W_theta,
        points of a scan, score threshold, and h_0 of eq. (13).
    """

    max_scans: int = 6000
    num_pairs: int = 50
    num_varied: int = 15
    num_plain: int = 7
    num_checked: int = 2
    num_as_written: int = 2
    num_global_checked: int = 1
    min_num_points: int = 150
    linear_m: tuple[float, ...] = (1.0, 2.0, 5.0, 7.0, 10.0)
    angular_deg: tuple[float, ...] = (10.0, 30.0, 90.0, 180.0)
    num_points: tuple[int, ...] = (50, 100, 180, 360, 1000)
    min_scores: tuple[float, ...] = (0.4, 0.5, 0.55, 0.6, 0.7)
    tops: tuple[int, ...] = (3, 4, 5, 6, 7, 8)
    window: Window = PAPER_WINDOW


@dataclass(frozen=True, slots=True)
class Group:
    """Pairs of one recording and one outcome.

    Attributes
    ----------
    place, outcome, pairs : the recording, "hit" or "miss", and the pairs.
    notes : remarks for the table.
    """

    place: Place
    outcome: str
    pairs: list[Pair]
    notes: str

    def case(self, part: str, **varied: str | int | float) -> Case:
        """Return the case of a row."""
        return {"part": part, "source": self.place.source, "pairs": self.outcome, **varied}


def run(repeats: int, data: Path | None, sizes: Sizes | None = None) -> Record:
    """Return the benchmark's rows.

    Parameters
    ----------
    repeats : searches of each pair that are timed.
    data : folder of the recordings; None or without them: an office floor is simulated.
    sizes : how much to measure; by default as for the documentation.

    Raises
    ------
    CartoloopError
        Two exact searches return different matches.
    """
    sizes = sizes or Sizes()
    places, missing = map_places(data, sizes.max_scans)
    groups = [group for place in places for group in _groups(place, sizes)]
    first = [group for group in groups if group.place is places[0] and group.pairs]
    rows: list[Row] = []
    for group in groups:
        rows += hit_and_miss_rows(group, repeats, sizes)
    for group in first:
        rows += varied_rows(group, repeats, sizes)
    for group in groups:
        if group.pairs:
            num_checked = sizes.num_global_checked if group in first else 0
            rows.append(global_row(group, repeats, replace(sizes, num_checked=num_checked)))
    for group in first:
        rows += bounds_rows(group, repeats, sizes)
        rows += top_rows(group, repeats, sizes)
    rows += [grids_row(place, repeats) for place in places]
    rows += [
        Row(
            {"part": "hits and misses", "source": name},
            notes=f"{name}.clf.gz is missing: give the folder of the recordings by --data",
        )
        for name in missing
    ]
    rows[0] = replace(rows[0], notes=f"{HOW}; {rows[0].notes}")
    return Record("matching", tuple(rows), environment())


def _groups(place: Place, sizes: Sizes) -> Iterator[Group]:
    """Yield the hits and the misses of what was mapped."""
    found = hits(place, sizes.num_pairs, sizes.window, sizes.min_num_points)
    few = f"; only {len(found)} revisits" if len(found) < sizes.num_pairs else ""
    yield Group(place, "hit", found, HITS + few)
    unlike, num_alike = misses(place, sizes.num_pairs, sizes.window, sizes.min_num_points)
    few = f"; only {len(unlike)} pairs from elsewhere" if len(unlike) < sizes.num_pairs else ""
    if num_alike:
        few += f"; {num_alike} more match by chance and are left out"
    yield Group(place, "miss", unlike, MISSES + few)


def hit_and_miss_rows(group: Group, repeats: int, sizes: Sizes) -> list[Row]:
    """Return the rows of all pairs of a group, with and without the runner-up."""
    case, window = group.case("hits and misses", **_window_case(sizes.window)), sizes.window
    problems = [pair.problem(window) for pair in group.pairs]
    if not problems:
        return [Row(case, notes=group.notes)]
    figures = search_figures(problems, repeats, sizes.num_plain, sizes.num_checked)
    checked = problems[: sizes.num_as_written]
    figures |= exhaustive_figures(
        exhaustive_as_written, checked, repeats, "as written", "ratio as written"
    )
    exact = [sample_seconds(partial(branch_and_bound, p, RUNNER_UP), repeats) for p in problems]
    return [
        Row(case, figures, group.notes),
        Row(
            group.case("with exact runner-up", **_window_case(window)),
            {"search": milliseconds(exact)},
            "as in the mapper: the best match elsewhere, down to the score threshold",
        ),
    ]


def varied_rows(group: Group, repeats: int, sizes: Sizes) -> list[Row]:
    """Return the rows that vary W_x = W_y, W_theta, the points of a scan, and the threshold."""
    window, pairs = sizes.window, group.pairs[: sizes.num_varied]
    near = Window(min(sizes.linear_m), math.radians(min(sizes.angular_deg)))

    def row(part: str, problems: Sequence[Problem], **varied: int) -> Row:
        return _varied_row(group, part, problems, repeats, sizes, **varied)

    def in_window(part: str, varied: Window, estimate_window: Window | None = None) -> Row:
        return row(part, [pair.problem(varied, estimate_window) for pair in pairs])

    def with_points(count: int) -> Row:
        clouds = [group.place.cloud(pair.node, count) for pair in pairs]
        problems = [
            pair.problem(window, points=cloud) for pair, cloud in zip(pairs, clouds, strict=True)
        ]
        return row("points", problems, points=count)

    angles = [math.radians(angle) for angle in sizes.angular_deg]
    return [
        *(in_window("window size", replace(window, linear=w), near) for w in sizes.linear_m),
        *(in_window("window angle", replace(window, angular=w), near) for w in angles),
        *(with_points(count) for count in sizes.num_points),
        *(in_window("threshold", replace(window, min_score=s)) for s in sizes.min_scores),
    ]


def global_row(group: Group, repeats: int, sizes: Sizes) -> Row:
    """Return the row of searches at all rotations in the whole submap."""
    problems = [
        global_problem(pair.problem(sizes.window)) for pair in group.pairs[: sizes.num_varied]
    ]
    return _varied_row(group, "global search", problems, repeats, sizes)


def bounds_rows(group: Group, repeats: int, sizes: Sizes) -> list[Row]:
    """Return the rows of one search, algorithm 3 as written, bounded by different grids."""
    top = 6
    kinds = {
        "precomputed, eq. (17)": bounding_grids.precomputed,
        "halved resolution, up to 2 x 2 cells": bounding_grids.halved,
        "halved resolution, cells joined": bounding_grids.halved_and_joined,
    }
    problems = [pair.problem(sizes.window) for pair in group.pairs[: sizes.num_plain]]
    programs = {name: (make_grids, top) for name, make_grids in kinds.items()}
    rows = [
        Row(
            group.case("bounds", bounds=name, top=top, **_window_case(sizes.window)),
            figures,
            "one plain search, no vector instructions, only the bounding grids differ",
        )
        for name, figures in plain_figures(problems, programs, repeats).items()
    ]
    own = search_figures(problems, repeats, sizes.num_plain, 0)
    own["memory"] = Figure.exact(
        float(np.median([problem.matcher.memory_bytes for problem in problems])) / 1e6, "MB"
    )
    case = group.case("bounds", bounds="this project's matcher", **_window_case(sizes.window))
    return [*rows, Row(case, own, "groups of rotations, blocks of points, vector instructions")]


def top_rows(group: Group, repeats: int, sizes: Sizes) -> list[Row]:
    """Return the rows of trees of different heights h_0, with the paper's grids."""
    problems = [pair.problem(sizes.window) for pair in group.pairs[: sizes.num_plain]]
    programs = {str(top): (bounding_grids.precomputed, top) for top in sizes.tops}
    return [
        Row(
            group.case("tree height", top=int(top), **_window_case(sizes.window)),
            figures,
            "the plain search of the part 'bounds'",
        )
        for top, figures in plain_figures(problems, programs, repeats).items()
    ]


def grids_row(place: Place, repeats: int) -> Row:
    """Return the row of making the precomputed grids of each submap."""
    submaps = [grid.cells for grid in place.grids if grid.size]
    seconds = [sample_seconds(partial(PrecomputationGrids, cells), repeats) for cells in submaps]
    return Row(
        {"part": "precomputed grids", "source": place.source},
        {
            "build": milliseconds(seconds),
            "memory": Figure.exact_of_inputs(
                [PrecomputationGrids(cells).cells.nbytes / 1e6 for cells in submaps], "MB"
            ),
            "pixels": Figure.exact_of_inputs([cells.size for cells in submaps], "", None),
        },
        f"all grids of a submap; median and spread over {len(submaps)} submaps",
    )


def _varied_row(
    group: Group,
    part: str,
    problems: Sequence[Problem],
    repeats: int,
    sizes: Sizes,
    **varied: str | int | float,
) -> Row:
    case = group.case(part, **varied, **_window_case(problems[0].window))
    return Row(case, search_figures(problems, repeats, sizes.num_plain, sizes.num_checked))


def _window_case(window: Window) -> Case:
    """Return the part of a row's case that describes the window."""
    if not math.isfinite(window.linear):
        return {"window": "whole submap, ±180°", "min score": window.min_score}
    size = f"±{window.linear:g} m, ±{math.degrees(window.angular):g}°"
    return {"window": size, "min score": window.min_score}
