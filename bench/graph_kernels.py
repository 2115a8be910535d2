# SPDX-License-Identifier: Apache-2.0
"""Workloads of the pose adjustment and of the choice of pairs, on synthetic pose graphs."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from bench.adjustment.chordal_initialization import initialize_from_constraints
from bench.adjustment.problem import OwnProgram, Problem
from bench.adjustment.synthetic_graphs import bipartite_graph
from bench.record import Case
from bench.workload import Workload
from cartoloop.config import Config
from cartoloop.global_slam.claims import Claims
from cartoloop.global_slam.hypotheses import Candidate
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, constraint_residuals
from cartoloop.global_slam.submap_paths import SubmapPaths
from cartoloop.kernels.csv_rows import MAX_DIGITS, write_rows
from cartoloop.kernels.due_pairs import NodePlace, PairRule, pairs_of_node
from cartoloop.kernels.wide_windows import WindowRule, drift_windows
from cartoloop.pose_adjustment import Loss
from cartoloop.sensor.pose import compose_all

GRAPHS = ((1_000, 12, 3_000), (11_456, 128, 35_300))
"""Nodes, submaps and constraints of the graphs; the second is of the paper's museum's size."""

GRAPH_KERNELS = (
    "adjust",
    "adjust, one step",
    "residuals",
    "check",
    "chordal start",
    "shortest paths",
    "pairs",
    "windows",
    "claims",
    "write rows",
)


def graph_workloads() -> Iterator[Workload]:
    """Yield the adjustment of pose graphs from a drifted start, its parts, and the pair choice."""
    for nodes, submaps, edges in GRAPHS:
        graph = bipartite_graph(nodes, submaps, edges).graph
        case: Case = {"input": f"{nodes:,} nodes, {submaps} submaps"}
        size = len(graph.kinds)
        adjusting = ("pose_adjustment", "sparse_cholesky")
        for name, iterations in (("adjust", 50), ("adjust, one step", 1)):
            problem = Problem.of(graph, AdjustmentOptions(Loss.HUBER, max_iterations=iterations))
            yield Workload(
                name, adjusting, case, OwnProgram(problem).solve, size, "constraints"
            )  # fmt: skip
        yield Workload(
            "residuals", ("pose_adjustment",), case,
            partial(constraint_residuals, graph), size, "constraints",
        )  # fmt: skip
        yield Workload(
            "check", ("constraint_faults",), case,
            partial(graph.without, np.zeros(size, dtype=bool)), size, "constraints",
        )  # fmt: skip
        yield Workload(
            "chordal start", (), case,
            partial(initialize_from_constraints, copy.deepcopy(graph)), size, "constraints",
        )  # fmt: skip
    yield _shortest_paths_workload()
    yield _pairs_workload()
    yield _windows_workload()
    yield _claims_workload()
    yield _csv_workload()


def _shortest_paths_workload() -> Workload:
    """Return the search for the shortest paths from the newest submap of the larger graph."""
    _, submaps, _ = GRAPHS[-1]
    again = np.arange(submaps // 2)
    closures = np.column_stack((again, again + submaps // 2))  # all of it was walked twice
    travelled = np.arange(0.0, 17.0 * submaps, 17.0)
    config = Config().global_slam.constraint_search

    inside = np.zeros(len(closures))

    def find() -> None:
        SubmapPaths(config, travelled, closures, inside).lengths_from(submaps - 1)

    return Workload(
        "shortest paths",
        ("shortest_paths",),
        {"input": f"{submaps} submaps"},
        find,
        submaps,
        "submaps",
    )


def _pairs_workload() -> Workload:
    """Return the choice of the submaps to search for a node of the larger graph."""
    nodes, submaps, _ = GRAPHS[-1]
    graph = bipartite_graph(*GRAPHS[-1]).graph
    selection = Config().global_slam.constraint_search
    travelled = 0.2 * nodes * np.arange(submaps) / submaps
    rule = PairRule(
        math.inf,
        math.inf,
        selection.well_constrained_length,
        selection.every_nth_node,
        selection.every_nth_well_constrained_node,
    )
    x, y, theta = graph.node_poses[-1].tolist()
    newest = NodePlace(
        nodes - 1, x, y, theta, 0.2 * nodes, submaps - 1, submaps - 1, submaps - 1, 0.0
    )
    find = partial(
        pairs_of_node, newest[:], submaps, graph.submap_poses, travelled,
        np.full(submaps, np.inf), rule[:],
        np.empty(submaps, dtype=np.int32), np.empty(submaps), np.empty((submaps, 3)),
    )  # fmt: skip
    case: Case = {"input": f"{nodes:,} nodes, {submaps} submaps"}
    return Workload("pairs", ("due_pairs",), case, find, submaps, "submaps")


def _windows_workload() -> Workload:
    """Return where the drift may place a node in the submaps of the larger graph."""
    _, submaps, _ = GRAPHS[-1]
    rng = np.random.default_rng(0)
    poses = rng.uniform(-50.0, 50.0, (submaps, 3))
    boxes = np.tile((-15.0, -15.0, 15.0, 15.0), (submaps, 1))
    drift = np.tile(np.diag((4.0, 4.0, 0.01)), (submaps, 1, 1))
    find = partial(
        drift_windows, np.arange(submaps), drift, (0.0, 0.0, 0.0), poses, boxes,
        WindowRule(3.0, 0.5, 0.1, 0.04, 0.002)[:], np.empty((submaps, 6)),
    )  # fmt: skip
    case: Case = {"input": f"{submaps} submaps"}
    return Workload("windows", ("wide_windows",), case, find, submaps, "submaps")


def _claims_workload() -> Workload:
    """Return the comparison of claims about two corridors, each at one of four places."""
    count, rng = 1_000, np.random.default_rng(0)
    places = compose_all(np.array((7.0, -3.0, 1.0)), rng.uniform(-9.0, 9.0, (4, 3)))
    other = rng.uniform((-20.0, -2.0, -math.pi), (20.0, 2.0, math.pi), (count, 3))
    one = compose_all(places[rng.integers(0, 4, count)], other)
    candidates = [Candidate(row, row, 0, other[row], 0.6, 0.5) for row in range(count)]
    claims = Claims(candidates, one, other, np.full(count, 0.1))
    compare = partial(claims.agreement, Config().global_slam.constraint_search.wide_search)
    return Workload(
        "claims", ("pose_agreement",), {"input": f"{count:,} claims"}, compare, count**2, "pairs"
    )


def _csv_workload() -> Workload:
    """Return the writing of a table like closures.csv: two words and ten numbers a row."""
    rows, columns = 10_000, 10
    words = np.frombuffer(b"final" + b"fits", dtype=np.uint8)
    bounds = np.array((0, 5, 9), dtype=np.int64)
    codes = np.tile(np.array((0, 1), dtype=np.int64), (rows, 1))
    numbers = np.random.default_rng(0).uniform(-20.0, 20.0, (rows, columns))
    decimals = np.full(columns, 6, dtype=np.int64)
    text = np.empty(rows * (len(words) + 2 + columns * (MAX_DIGITS + 1)), dtype=np.uint8)
    write = partial(write_rows, words, bounds, codes, numbers, decimals, text)
    case: Case = {"input": f"{rows:,} rows of {columns} numbers"}
    return Workload("write rows", ("csv_rows",), case, write, rows, "rows")
