# SPDX-License-Identifier: Apache-2.0
"""Workloads of the kernels that take finished submaps: comparison, search, composition."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from bench.drives import Drive
from bench.record import Case
from bench.workload import Workload
from cartoloop.arrays import FloatArray
from cartoloop.config import LifelongConfig
from cartoloop.global_slam import refinement
from cartoloop.global_slam.closure_search import FinishedSubmap, mean_score
from cartoloop.kernels.map_changes import LookLimits, note_look
from cartoloop.lifelong.selection import select
from cartoloop.localisation.changes.watch import no_looks
from cartoloop.localisation.known_map import KnownMap
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.map_output.surveyed_floor import surveyed
from cartoloop.quality.agreement import agreement
from cartoloop.quality.corridor_shifts import fitting_shifts
from cartoloop.quality.encounters import shifts_in
from cartoloop.quality.pairs import agreement_limits, cell_grid
from cartoloop.scan_matching.branch_and_bound import SubmapMatcher
from cartoloop.scan_matching.precomputation_grid import PrecomputationGrids
from cartoloop.sensor.pose import IDENTITY, Pose, compose, relative, transform_points
from cartoloop.sensor.scan_points import ScanPoints


def submap_workloads(driven: Drive) -> Iterator[Workload]:
    """Yield all workloads of the finished submaps of a drive."""
    yield from _comparison_workloads(driven)
    yield from _search_workloads(driven)
    yield from _map_workloads(driven)


def _map_changes(known: KnownMap, tf_map_scan: Pose, points: FloatArray, case: Case) -> Workload:
    """Return the comparison of a scan with a map, cell by cell."""
    grid = known.cell_grid
    origin = np.array((grid.origin_x, grid.origin_y))
    start = (np.array(tf_map_scan[:2]) - origin) / grid.resolution
    ends = (transform_points(tf_map_scan, points) - origin) / grid.resolution
    limits = LookLimits(200, 100, 1.5, 0.4, 0.005, 6.0, 2.0, 10)
    looks = no_looks(grid.cells.shape)
    note = partial(
        note_look, grid.cells, limits, float(start[0]), float(start[1]), ends, 1, 0.0, looks
    )
    return Workload("changes", ("map_changes",), case, note, len(ends), "beams")


def _own_nodes(driven: Drive) -> tuple[list[FloatArray], list[Pose]]:
    """Return the points of the nodes of the first submap, and their poses in it."""
    submap = driven.finished[0]
    own = [node for node in driven.nodes if submap in node.submaps]
    in_submap = [relative(submap.tf_local_submap, node.tf_local_tracking) for node in own]
    return [node.points for node in own], in_submap


def _comparison_workloads(driven: Drive) -> Iterator[Workload]:
    """Yield the steps that finish a submap, and the comparison of its scans with it."""
    grid = driven.grids[0]
    case: Case = {"input": driven.name}
    finish = driven.finished[0].grid.finish
    yield Workload("finish", ("cell_values",), case, finish, grid.size, "pixels")
    yield Workload(
        "precompute", ("precomputation_grid",), case,
        partial(PrecomputationGrids, grid.cells), grid.size, "pixels",
    )  # fmt: skip
    points, in_submap = _own_nodes(driven)
    yield Workload(
        "mean score", ("sum_at_points",), case,
        partial(mean_score, grid, ScanPoints.of(points), np.array(in_submap)),
        sum(map(len, points)), "points",
    )  # fmt: skip
    yield Workload(
        "agree", ("map_agreement",), case,
        partial(
            agreement, cell_grid(grid), agreement_limits(grid.resolution, math.inf),
            ScanPoints.of(points), np.array(in_submap),
        ),
        sum(map(len, points)), "points",
    )  # fmt: skip
    along = np.array([[1.0, 0.0]])
    together = np.zeros(len(points), dtype=np.int64)
    yield Workload(
        "shift along a corridor", ("shift_costs",), case,
        partial(fitting_shifts, grid, ScanPoints.of(points), np.array(in_submap), together, along),
        sum(map(len, points)), "points",
    )  # fmt: skip
    known = KnownMap(
        grid.cells, grid.origin_x, grid.origin_y, grid.resolution, IDENTITY, "a submap"
    )
    yield Workload(
        "fit", ("scan_fit", "straight_walls"), case,
        partial(known.fit_all, ScanPoints.of(points), np.zeros((len(points), 2)),
                np.array(in_submap)),
        sum(map(len, points)), "points",
    )  # fmt: skip
    yield _map_changes(known, in_submap[0], points[0], case)
    group = transform_points(Pose(*in_submap[0]), points[0])
    yield Workload(
        "displace", ("map_agreement",), case,
        partial(shifts_in, grid, ScanPoints.of([group]), 1.0), len(group), "points",
    )  # fmt: skip


def _search_workloads(driven: Drive) -> Iterator[Workload]:
    """Yield the search for a scan in a submap, and the match of its own scans from their poses."""
    grid = driven.grids[0]
    case: Case = {"input": driven.name}
    search = driven.config.global_slam.constraint_search
    points, in_submap = _own_nodes(driven)
    matcher = SubmapMatcher(grid)
    middle = len(points) // 2
    search_for = partial(
        matcher.match,
        linear_window=7.0, angular_window=math.radians(30.0), min_score=search.min_score,
    )  # fmt: skip
    off = compose(in_submap[middle], Pose(2.0, -1.5, 0.2))
    for name, estimate, cloud in (("hit", off, points[middle]), ("miss", off, driven.points)):
        yield Workload(
            "branch and bound",
            ("branch_and_bound", "node_bounds", "search_batch", "search_order", "search_tree",
             "search_window"),
            {**case, "window": f"±7 m, ±30°, {name}"},
            partial(search_for, cloud, estimate), len(cloud), "points",
        )  # fmt: skip
    finished = FinishedSubmap(0, grid, 1.0)
    yield Workload(
        "match again",
        ("match_batch", "match_covariance", "scan_batch", "scan_residuals", "smooth_map"), case,
        partial(
            refinement.match_again, finished, np.zeros(3), np.arange(len(points)),
            np.array(in_submap),
            ScanPoints.of(points), search,
        ),
        len(points), "scans",
    )  # fmt: skip


def _map_workloads(driven: Drive) -> Iterator[Workload]:
    """Yield the steps that make a map of all submaps."""
    case: Case = {"input": driven.name}
    poses = np.array([submap.tf_local_submap for submap in driven.finished])
    yield Workload(
        "compose map", ("map_composition",), case,
        partial(compose_map, driven.grids, poses, driven.config.local_slam.submaps),
        sum(grid.size for grid in driven.grids), "pixels",
    )  # fmt: skip
    whole = compose_map(driven.grids, poses, driven.config.local_slam.submaps)
    yield Workload(
        "survey", ("floor_blocks",), case,
        partial(surveyed, whole, driven.config.map_output.free_thresh, poses[:, :2]),
        whole.probability.size, "pixels",
    )  # fmt: skip
    twice = np.repeat((0, 1), len(poses))
    yield Workload(
        "fade", ("fading", "map_composition"), case,
        partial(
            select, [*driven.grids, *driven.grids], np.vstack((poses, poses)), twice,
            np.ones(len(twice), dtype=bool),
            driven.config.local_slam.submaps, LifelongConfig(),
        ),
        2 * sum(grid.size for grid in driven.grids), "pixels",
    )  # fmt: skip
