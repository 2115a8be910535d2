# SPDX-License-Identifier: Apache-2.0
"""``python -m bench adjustment``: our pose adjustment against GTSAM, Ceres and g2o, in turn.

All programs have the same graph, start, loss and stopping rule (a relative change of the cost of
1e-6), and one thread. The time is from the graph as the program holds it to the poses. Ours is
measured twice: once for all of :func:`cartoloop.global_slam.pose_adjustment.adjust`, which also
sorts and packs the constraints, and once without that, because the other programs do it when their
graph is built, and the mapper when constraints arrive. One evaluator computes the cost of all
results. g2o gets the number of iterations beforehand, which saves it the evaluations of its
stopping rule. The programs run in turn, so each starts with the data of another in the processor's
caches, as an adjustment while mapping does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bench.adjustment.chordal_initialization import (
    initialize_from_constraints,
    starts_far_off,
)
from bench.adjustment.compiled_drivers import SolverMissing
from bench.adjustment.foreign_solvers import ForeignSolvers, Method
from bench.adjustment.grid_world import grid_world
from bench.adjustment.problem import OwnProgram, Problem, Program, Solve
from bench.adjustment.synthetic_graphs import bipartite_graph
from bench.environment import environment
from bench.g2o import read_g2o
from bench.record import Better, Case, Figure, Record, Row
from cartoloop.global_slam.pose_adjustment import adjust
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.sensor.pose import Pose, compose, compose_all, inverse

OWN_NAME, HELD_NAME = "cartoloop", "cartoloop, graph held"
MUSEUM = (11_456, 128, 35_300)
"""Nodes, submaps and constraints of the paper's museum (section VI-A)."""
SIZES = (1_000, 3_000, 10_000, 30_000, 100_000)
"""Nodes of the other synthetic graphs."""
GRID_SIZES = (2_000, 20_000)
"""Nodes of the grid worlds."""

_SUBMAPS_PER_NODE = 0.011
_EDGES_PER_NODE = 35_300 / 11_456
_NEW_NODES = 90
"""Nodes added between two adjustments while mapping."""
_STUCK = 1.01
"""Least ratio of costs at which a result counts as another local minimum."""
_SAME_COST = 1e-3
"""Largest relative difference of costs that is not remarked on."""
_TIME_A_PROGRAM_S = 1.0
"""Time for the repeats of a program [s]; a slower program is repeated less often."""
_FEWEST_ROUNDS = 3
"""Least number of repeats for a spread."""
_TOO_LONG_TO_REPEAT_S = 3.0
"""Time of a first run from which on it is not repeated [s]."""
_LONGEST_SOLVE_S = 20.0
"""Longest expected solve of a foreign program that is run [s]."""


@dataclass
class _Runs:
    """The runs of a program on one graph; `cost` is that of its result."""

    cost: float
    first: Solve
    samples: list[float] = field(default_factory=list)


def run(
    repeats: int,
    data: Path | None,
    largest: int = 100_000,
    foreign: Callable[[ForeignSolvers], list[Method]] = ForeignSolvers.methods,
) -> Record:
    """Time all programs on the public graphs and on synthetic ones.

    Parameters
    ----------
    repeats : number of timed runs of each, fewer for slow programs.
    data : folder whose ``pose-graphs`` holds g2o files; None: there is none, a row says so.
    largest : nodes of the largest synthetic graph.
    foreign : which foreign programs are compared.

    Returns
    -------
    record : a row for each graph and program; one that is not installed, or failed, says why.
    """
    rows: list[Row] = []
    with ForeignSolvers() as solvers:
        methods = foreign(solvers)
        slow: dict[str, float] = {}
        for name, problem in _public_problems(data):
            rows += _compare(name, problem, methods, repeats, {})
        if not rows:
            rows.append(Row({"graph": "public pose graphs"}, notes=_missing_note(data)))
        for name, problem in _synthetic_problems(largest):
            rows += _compare(name, problem, methods, repeats, slow)
        slow = {}
        for name, problem in _grid_problems(largest):
            rows += _compare(name, problem, methods, repeats, slow)
    return Record("adjustment", tuple(rows), environment())


def _missing_note(data: Path | None) -> str:
    folder = "" if data is None else f" in {data / 'pose-graphs'}"
    return f"no g2o files{folder}: give the folder of the recordings by --data"


def _public_problems(data: Path | None) -> Iterator[tuple[str, Problem]]:
    """Yield the graphs of files; again from a chordal start where theirs is too far off."""
    paths = [] if data is None else sorted((data / "pose-graphs").glob("*.g2o*"))
    for path in paths:
        name = path.name.partition(".")[0]
        if not name.lower().endswith("groundtruth"):
            yield from _starts(name, read_g2o(path))


def _starts(name: str, graph: PoseGraph) -> Iterator[tuple[str, Problem]]:
    """Yield the problem of a graph; where its start is far off, also from a chordal start.

    From far off our program makes a chordal start itself; the others need to be given one.
    """
    problem = Problem.of(graph)
    is_far = starts_far_off(graph)
    initialize_from_constraints(graph)
    chordal = Problem.of(graph)
    problem.place(problem.start)
    yield name, problem
    if is_far:
        chordal.place(chordal.start)
        yield f"{name}, chordal start", chordal


def _synthetic_problems(largest: int) -> Iterator[tuple[str, Problem]]:
    """Yield synthetic graphs in order of size; the museum's also as while mapping."""
    sizes = [(n, round(_SUBMAPS_PER_NODE * n), round(_EDGES_PER_NODE * n)) for n in SIZES]
    for size in sorted((*sizes, MUSEUM)):
        if size[0] > largest:
            continue
        graph = bipartite_graph(*size).graph
        yield ("museum" if size == MUSEUM else "synthetic"), Problem.of(graph)
        if size == MUSEUM:
            yield f"museum, {_NEW_NODES} nodes since", Problem.of(warm_start(graph, _NEW_NODES))


def _grid_problems(largest: int) -> Iterator[tuple[str, Problem]]:
    """Yield grid worlds from the chain of their steps, and from a chordal start."""
    for size in GRID_SIZES:
        if size <= largest:
            yield from _starts("grid world", grid_world(size)[0])


def warm_start(graph: PoseGraph, num_new: int) -> PoseGraph:
    """Return a graph as while mapping, when it has grown since the last adjustment.

    All but the newest nodes have the poses of an adjustment of that part. The newest nodes, and the
    submaps begun since, are placed relative to the last submap of that part.

    Parameters
    ----------
    graph : nodes and submaps in order of time; its poses become those of the returned graph.
    num_new : number of new nodes.
    """
    old_nodes = graph.num_nodes - num_new
    is_old = graph.index_b < old_nodes
    old_submaps = int(graph.index_a[is_old].max()) + 1
    old = PoseGraph()
    old.add_submaps(graph.submap_poses[:old_submaps])
    old.add_nodes(graph.node_poses[:old_nodes])
    old.add_constraints(
        graph.kinds[is_old],
        graph.index_a[is_old],
        graph.index_b[is_old],
        graph.relative_poses[is_old],
        graph.informations[is_old],
    )
    last_before = Pose(*old.submap_poses[-1].tolist())
    adjust(old)
    moved = np.array(compose(Pose(*old.submap_poses[-1].tolist()), inverse(last_before)))
    graph.submap_poses[:] = np.concatenate(
        (old.submap_poses, compose_all(moved, graph.submap_poses[old_submaps:]))
    )
    graph.node_poses[:] = np.concatenate(
        (old.node_poses, compose_all(moved, graph.node_poses[old_nodes:]))
    )
    return graph


def _compare(
    name: str, problem: Problem, methods: list[Method], repeats: int, slow: dict[str, float]
) -> list[Row]:
    """Return a row for each program; `slow` has the seconds per node on smaller graphs by name."""
    graph = problem.graph
    case: Case = {
        "graph": name,
        "nodes": graph.num_nodes,
        "submaps": graph.num_submaps,
        "edges": graph.num_constraints,
    }
    programs: dict[str, Program] = {
        OWN_NAME: OwnProgram(problem),
        HELD_NAME: OwnProgram(problem, is_held=True),
    }
    programs[OWN_NAME].solve()  # compiles
    runs = {name: _first_run(problem, program) for name, program in programs.items()}
    notes: dict[str, str] = {}
    for method in methods:
        if method.needs_submaps and graph.num_submaps == 0:
            continue
        expected = slow.get(method.name, 0.0) * graph.num_nodes
        if expected > _LONGEST_SOLVE_S:
            notes[method.name] = f"skipped: about {expected:.0f} s a solve"
            continue
        try:
            programs[method.name] = method.start(problem)
            runs[method.name] = _first_run(problem, programs[method.name])
        except SolverMissing as error:
            notes[method.name] = str(error)
            continue
        slow[method.name] = runs[method.name].first.seconds / graph.num_nodes
    turns = [name for name in runs if name != HELD_NAME]
    turns.insert(1 + len(turns) // 2, HELD_NAME)  # apart from the other, which fills the caches
    notes |= _repeat({name: programs[name] for name in turns}, runs, repeats)
    return [
        Row({**case, "solver": OWN_NAME}, _figures(runs[OWN_NAME])),
        Row({**case, "solver": HELD_NAME}, _figures(runs[HELD_NAME])),
        *(
            Row(
                {**case, "solver": name},
                _figures(found, runs[OWN_NAME], runs[HELD_NAME]),
                notes.get(name, "") or _cost_note(found, runs),
            )
            for name, found in runs.items()
            if name not in (OWN_NAME, HELD_NAME)
        ),
        *(
            Row({**case, "solver": name}, notes=note)
            for name, note in notes.items()
            if name not in runs
        ),
    ]


def _first_run(problem: Problem, program: Program) -> _Runs:
    """Return the first run of a program; it has failed if its cost is not finite."""
    first = program.solve()
    cost = problem.cost(program.poses())
    if not np.isfinite(cost):
        raise SolverMissing("failed: its poses are not finite")
    return _Runs(cost, first)


def _repeat(programs: dict[str, Program], runs: dict[str, _Runs], repeats: int) -> dict[str, str]:
    """Run the programs in turn, slow ones in fewer rounds, the slowest in none.

    A program that fails is not run again; its runs until then count. Returns a note for each of
    these programs by name.
    """
    notes: dict[str, str] = {}
    rounds = {
        name: min(repeats, max(_FEWEST_ROUNDS, int(_TIME_A_PROGRAM_S / found.first.seconds)))
        if found.first.seconds < _TOO_LONG_TO_REPEAT_S
        else 0
        for name, found in runs.items()
    }
    for number in range(repeats):
        for name, program in programs.items():
            if number < rounds[name] and name not in notes:
                try:
                    runs[name].samples.append(program.solve().seconds)
                except SolverMissing as error:
                    notes[name] = f"when repeated: {error}"
    for found in runs.values():
        if not found.samples:
            found.samples.append(found.first.seconds)
    return notes


def _figures(
    found: _Runs, own: _Runs | None = None, held: _Runs | None = None
) -> dict[str, Figure]:
    """Return the figures of a program, with ratios to our runs if these are given.

    There is no ratio for a program that ends at a higher cost than ours.
    """
    better: Better = "less" if own is None else None
    figures = {
        "time": Figure.of_samples([1e3 * seconds for seconds in found.samples], "ms", better),
        "cost": Figure.exact(found.cost, "", better),
        "iterations": Figure.exact(found.first.iterations, "", better),
    }
    for name, ours in (("times ours", own), ("times ours, graph held", held)):
        if ours is not None and found.cost <= _STUCK * ours.cost:
            median = float(np.median(ours.samples))
            ratios = [seconds / median for seconds in found.samples]
            figures[name] = Figure.of_samples(ratios, "", "more")
    return figures


def _cost_note(found: _Runs, runs: dict[str, _Runs]) -> str:
    ratio = found.cost / runs[OWN_NAME].cost
    return "" if abs(ratio - 1.0) <= _SAME_COST else f"ends at {ratio:,.4g} times our cost"
