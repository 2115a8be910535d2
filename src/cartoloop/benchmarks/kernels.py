# SPDX-License-Identifier: Apache-2.0
"""Time of a call of each compiled kernel, through the function that the mapper calls it by."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from functools import partial

import numpy as np

from cartoloop.benchmarks.adjustment.problem import OwnProgram, Problem
from cartoloop.benchmarks.adjustment.synthetic_graphs import bipartite_graph
from cartoloop.benchmarks.drives import DRIVES, Drive, drive, replay
from cartoloop.benchmarks.environment import environment
from cartoloop.benchmarks.input_kernels import INPUT_KERNELS, input_workloads
from cartoloop.benchmarks.measuring import alternate
from cartoloop.benchmarks.record import Case, Figure, Record, Row
from cartoloop.benchmarks.workload import Workload
from cartoloop.config import Config, CorrelativeMatcherConfig
from cartoloop.errors import ConfigError
from cartoloop.global_slam import refinement
from cartoloop.global_slam.chordal_initialization import initialize_from_constraints
from cartoloop.global_slam.closure_search import refine_all
from cartoloop.global_slam.finished_submap import FinishedSubmap, mean_score
from cartoloop.global_slam.pair_selection import PairSelection
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, constraint_residuals
from cartoloop.kernels import exhaustive_search, plain_search
from cartoloop.kernels.due_pairs import due_pairs
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.scan_matching import correlative
from cartoloop.scan_matching.branch_and_bound import SubmapMatcher
from cartoloop.scan_matching.precomputation_grid import PrecomputationGrids
from cartoloop.sensor.pose import Pose, compose, relative, transform_points
from cartoloop.sensor.range_filter import RangeFilter, thin
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.range_data_inserter import insert_cells, scan_cells
from cartoloop.submaps.submap import Submap

MEASURED_ELSEWHERE = {
    exhaustive_search.__name__: "matching",
    plain_search.__name__: "matching",
}
"""Modules of kernels that another benchmark measures."""

GRAPHS = ((1_000, 12, 3_000), (11_456, 128, 35_300))
"""Nodes, submaps and constraints of the graphs; the second is of the paper's museum's size."""


DRIVE_KERNELS = (
    "local SLAM", "filter", "thin", "cast rays", "update cells", "insert", "match", "correlative",
    "finish", "precompute", "mean score", "branch and bound", "match again", "compose map",
)  # fmt: skip
GRAPH_KERNELS = (
    "adjust",
    "adjust, one step",
    "residuals",
    "check",
    "chordal start",
    "ways",
    "pairs",
)
KERNELS = (*DRIVE_KERNELS, *GRAPH_KERNELS, *INPUT_KERNELS)
"""The names of what is measured, by what they are measured on."""


def run(repeats: int, only: Sequence[str] = ()) -> Record:
    """Return the time of a call of each kernel, of several sizes.

    Parameters
    ----------
    repeats : samples of each.
    only : names of kernels; all where empty.

    Raises
    ------
    ConfigError
        There is no kernel of a name.
    """
    for name in only:
        if name not in KERNELS:
            nearest = get_close_matches(name, KERNELS, n=1, cutoff=0.0)[0]
            raise ConfigError(f"no kernel '{name}' to measure; the nearest is '{nearest}'")
    chosen = tuple(only) or KERNELS
    rows = [_row(workload, repeats) for workload in workloads(chosen) if workload.kernel in chosen]
    return Record("kernels", tuple(rows), environment())


def workloads(only: Sequence[str] = KERNELS) -> Iterator[Workload]:
    """Yield all that is timed, and no more than it shares its inputs with.

    Parameters
    ----------
    only : names of kernels.
    """
    if set(only) & set(DRIVE_KERNELS):
        for name in DRIVES:
            driven = drive(name)
            yield from _scan_workloads(driven)
            yield from _match_workloads(driven)
            yield from _submap_workloads(driven)
    if set(only) & set(GRAPH_KERNELS):
        yield from _graph_workloads()
        yield _ways_workload()
        yield _pairs_workload()
    if set(only) & set(INPUT_KERNELS):
        yield from input_workloads()


def _row(workload: Workload, repeats: int) -> Row:
    samples = alternate({workload.kernel: workload.call}, repeats)[workload.kernel]
    each = [1e9 * sample / workload.items for sample in samples]
    return Row(
        {
            "kernel": workload.kernel,
            **workload.case,
            "items": f"{workload.items:,} {workload.item}",
        },
        {
            "call": Figure.of_samples([1e3 * sample for sample in samples], "ms"),
            "item": Figure.of_samples(each, "ns"),
        },
    )


def _scan_workloads(driven: Drive) -> Iterator[Workload]:
    """Yield all of local SLAM, and what happens to every scan, and to every one inserted."""
    config = driven.config
    case: Case = {"input": driven.name}
    scan, tf_local_tracking = driven.scans[-1], driven.poses[-1]
    yield Workload(
        "local SLAM", (), case, partial(replay, driven.events), driven.num_replayed, "scans"
    )
    beams = scan.geometry.num_beams
    range_filter = RangeFilter(config.sensor)
    data = range_filter.apply(scan)
    yield Workload(
        "filter", ("range_projection", "voxel_filter"), case,
        partial(range_filter.apply, scan), beams, "beams",
    )  # fmt: skip
    thinning = config.local_slam.adaptive_voxel_filter
    yield Workload(
        "thin", ("voxel_filter",), case,
        partial(thin, data.returns, thinning), len(data.returns), "points",
    )  # fmt: skip
    sensor = compose(tf_local_tracking, data.tf_tracking_sensor)
    returns = transform_points(tf_local_tracking, data.returns)
    misses = transform_points(tf_local_tracking, data.misses)
    resolution = config.local_slam.submaps.resolution
    rays = len(returns) + len(misses)
    yield Workload(
        "cast rays", ("ray_casting", "ray_fan", "pixel_rows"), case,
        partial(scan_cells, sensor, returns, misses, resolution), rays, "rays",
    )  # fmt: skip
    submap = copy.deepcopy(_growing(driven))
    cells = scan_cells(sensor, returns, misses, resolution)
    origin = (
        round(submap.tf_local_submap.x / resolution), round(submap.tf_local_submap.y / resolution),
    )  # fmt: skip
    update = partial(insert_cells, submap.grid, cells, config.local_slam.submaps, origin)
    num_cells = len(cells.hits) + int((cells.free[:, 2] - cells.free[:, 1]).sum())
    yield Workload("update cells", ("grid_update",), case, update, num_cells, "cells")

    def insert() -> None:
        insert_cells(
            submap.grid,
            scan_cells(sensor, returns, misses, resolution),
            config.local_slam.submaps,
            origin,
        )

    yield Workload("insert", ("ray_casting", "grid_update"), case, insert, rays, "rays")


def _match_workloads(driven: Drive) -> Iterator[Workload]:
    """Yield the matching of a scan against the submap that grows."""
    case: Case = {"input": driven.name}
    config, submap = driven.config.local_slam, _growing(driven)
    search = driven.config.global_slam.constraint_search
    data = RangeFilter(driven.config.sensor).apply(driven.scans[-1])
    points = thin(data.returns, config.adaptive_voxel_filter)
    in_submap = relative(submap.tf_local_submap, driven.poses[-1])
    start = compose(in_submap, Pose(0.03, -0.02, 0.01))
    finished = FinishedSubmap(0, submap.grid.finish(), 1.0)
    yield Workload(
        "match", ("match_batch", "scan_residuals", "smooth_map"), case,
        partial(
            refine_all, finished.smooth_map, ScanPoints.of([points]), np.array((start,)), search,
            math.inf,
        ),
        len(points), "points",
    )  # fmt: skip
    wide = CorrelativeMatcherConfig(linear_search_window=0.1, angular_search_window_deg=20.0)
    yield Workload(
        "correlative", ("correlative", "window_bounds"), {**case, "window": "±0.1 m, ±20°"},
        partial(correlative.match, submap.grid, points, start, wide, correlative.Scratch()),
        len(points), "points",
    )  # fmt: skip


def _submap_workloads(driven: Drive) -> Iterator[Workload]:
    """Yield what is done once for a finished submap, and the search of a scan in it."""
    grid = driven.grids[0]
    case: Case = {"input": driven.name}
    search = driven.config.global_slam.constraint_search
    submap = driven.finished[0]
    yield Workload("finish", ("cell_values",), case, submap.grid.finish, grid.size, "pixels")
    yield Workload(
        "precompute", ("precomputation_grid",), case,
        partial(PrecomputationGrids, grid.cells), grid.size, "pixels",
    )  # fmt: skip
    own = [node for node in driven.nodes if submap in node.submaps]
    in_submap = [relative(submap.tf_local_submap, node.tf_local_tracking) for node in own]
    points = [node.points for node in own]
    yield Workload(
        "mean score", ("sum_at_points",), case,
        partial(mean_score, grid, ScanPoints.of(points), np.array(in_submap)),
        sum(map(len, points)), "points",
    )  # fmt: skip
    matcher = SubmapMatcher(grid)
    middle = len(own) // 2
    sought = partial(
        matcher.match,
        linear_window=7.0, angular_window=math.radians(30.0), min_score=search.min_score,
    )  # fmt: skip
    off = compose(in_submap[middle], Pose(2.0, -1.5, 0.2))
    for name, estimate, cloud in (("hit", off, own[middle].points), ("miss", off, driven.points)):
        yield Workload(
            "branch and bound",
            ("branch_and_bound", "node_bounds", "search_batch", "search_tree"),
            {**case, "window": f"±7 m, ±30°, {name}"},
            partial(sought, cloud, estimate), len(cloud), "points",
        )  # fmt: skip
    finished = FinishedSubmap(0, grid, 1.0)
    yield Workload(
        "match again", ("match_batch", "match_covariance", "scan_residuals", "smooth_map"), case,
        partial(
            refinement.match_again, finished, np.zeros(3), np.arange(len(own)), np.array(in_submap),
            ScanPoints.of(points), search,
        ),
        len(own), "scans",
    )  # fmt: skip
    poses = np.array([submap.tf_local_submap for submap in driven.finished])
    yield Workload(
        "compose map", ("map_composition",), case,
        partial(compose_map, driven.grids, poses, driven.config.local_slam.submaps),
        sum(grid.size for grid in driven.grids), "pixels",
    )  # fmt: skip


def _graph_workloads() -> Iterator[Workload]:
    """Yield the adjustment of pose graphs from a drifted start, and its parts."""
    for nodes, submaps, edges in GRAPHS:
        graph = bipartite_graph(nodes, submaps, edges).graph
        case: Case = {"input": f"{nodes:,} nodes, {submaps} submaps"}
        size = len(graph.kinds)
        adjusting = ("pose_adjustment", "sparse_cholesky")
        for name, iterations in (("adjust", 50), ("adjust, one step", 1)):
            problem = Problem.of(graph, AdjustmentOptions(max_iterations=iterations))
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


def _ways_workload() -> Workload:
    """Return how far it is from the newest submap of the larger graph to all others."""
    _, submaps, _ = GRAPHS[-1]
    again = np.arange(submaps // 2)
    closures = np.column_stack((again, again + submaps // 2))  # all of it was walked twice
    travelled = np.arange(0.0, 17.0 * submaps, 17.0)
    selection = PairSelection(Config().global_slam.constraint_search)

    def find() -> None:
        selection.update(travelled, closures)
        selection.ways_from(submaps - 1)

    return Workload(
        "ways", ("shortest_ways",), {"input": f"{submaps} submaps"}, find, submaps, "submaps"
    )


def _pairs_workload() -> Workload:
    """Return which submaps of the larger graph a node that lies among all of them is sought in."""
    nodes, submaps, _ = GRAPHS[-1]
    graph = bipartite_graph(*GRAPHS[-1]).graph
    selection = Config().global_slam.constraint_search
    begun = np.arange(submaps) * nodes // submaps
    node_submaps = np.repeat((np.arange(nodes) * submaps // nodes)[:, np.newaxis], 2, axis=1)
    travelled = np.linspace(0.0, 0.2 * nodes, nodes)
    find = partial(
        due_pairs, 0, submaps, nodes - 1, nodes, graph.submap_poses, graph.node_poses, math.inf,
        np.ones(nodes, dtype=bool), travelled, node_submaps, travelled[begun],
        np.empty((2, 0), dtype=np.int64), 0.5, np.full(submaps, np.inf), False,
        selection.bound_length, selection.every_nth_node, selection.every_nth_bound_node,
        np.empty((submaps, 3), dtype=np.int64), np.empty(submaps), np.empty((submaps, 3)),
    )  # fmt: skip
    case: Case = {"input": f"{nodes:,} nodes, {submaps} submaps"}
    return Workload("pairs", ("due_pairs",), case, find, submaps, "submaps")


def _growing(driven: Drive) -> Submap:
    assert driven.growing is not None
    return driven.growing
