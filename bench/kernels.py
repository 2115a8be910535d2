# SPDX-License-Identifier: Apache-2.0
"""``python -m bench kernels``: time of each kernel, called by the mapper's own functions."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from functools import partial

import numpy as np

from bench.drives import DRIVES, Drive, drive, replay
from bench.environment import environment
from bench.graph_kernels import GRAPH_KERNELS, graph_workloads
from bench.input_kernels import INPUT_KERNELS, input_workloads
from bench.measuring import alternate
from bench.record import Case, Figure, Record, Row
from bench.workload import Workload
from cartoloop.arrays import FloatArray
from cartoloop.config import CorrelativeMatcherConfig, LifelongConfig
from cartoloop.errors import ConfigError
from cartoloop.global_slam import refinement
from cartoloop.global_slam.closure_search import FinishedSubmap, mean_score, refine_all
from cartoloop.kernels.changed_ranges import any_changed
from cartoloop.kernels.map_changes import LookLimits, note_look
from cartoloop.kernels.moved_points import moved_points
from cartoloop.kernels.order_statistics import distance_quantile
from cartoloop.lifelong.selection import select
from cartoloop.local_slam.wall_step import WallStep
from cartoloop.localisation.changes.watch import no_looks
from cartoloop.localisation.known_map import KnownMap
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.map_output.surveyed_floor import surveyed
from cartoloop.quality.agreement import agreement
from cartoloop.quality.corridor_shifts import fitting_shifts
from cartoloop.quality.encounters import shifts_in
from cartoloop.quality.pairs import agreement_limits, cell_grid
from cartoloop.quality.scan_changes import num_changed
from cartoloop.scan_matching import correlative
from cartoloop.scan_matching.branch_and_bound import SubmapMatcher
from cartoloop.scan_matching.precomputation_grid import PrecomputationGrids
from cartoloop.sensor.free_standing import are_free_standing
from cartoloop.sensor.isolated_returns import without_isolated
from cartoloop.sensor.pose import IDENTITY, Pose, compose, relative, transform_points
from cartoloop.sensor.range_filter import RangeFilter, thin
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.sensor.slanting_walls import without_hidden
from cartoloop.sensor.wall_normals import chord_ratio
from cartoloop.sensor.wall_smoothing import smoothed
from cartoloop.submaps.probability_grid import (
    cells_with_walls,
    insert_cells,
    scan_cells,
)
from cartoloop.submaps.submap import Submap

DRIVE_KERNELS = (
    "local SLAM", "filter", "smooth", "hide", "far", "changed", "chords", "isolated", "people",
    "outline", "thin", "move", "cast rays", "update cells", "insert", "match", "correlative",
    "wall step",
    "finish", "precompute", "mean score", "agree", "shift along a corridor", "fit", "changes",
    "displace", "branch and bound", "match again", "compose map", "survey", "fade",
)  # fmt: skip
KERNELS = (*DRIVE_KERNELS, *GRAPH_KERNELS, *INPUT_KERNELS)
"""The names of the kernels, grouped by the input that they are measured on."""


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
    """Yield the workloads of kernels, and of those that share their inputs.

    Parameters
    ----------
    only : names of kernels.
    """
    if set(only) & set(DRIVE_KERNELS):
        for name in DRIVES:
            driven = drive(name)
            yield from _scan_workloads(driven)
            yield from _match_workloads(driven)
            yield _wall_step(driven)
            yield from _submap_workloads(driven)
    if set(only) & set(GRAPH_KERNELS):
        yield from graph_workloads()
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
    """Yield local SLAM as a whole, and the steps for every scan and for every inserted scan."""
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
        "filter",
        ("near_neighbours", "range_projection", "slanting_walls", "voxel_filter", "wall_smoothing"),
        case, partial(range_filter.apply, scan), beams, "beams",
    )  # fmt: skip
    step, range_max = scan.geometry.angle_increment, scan.geometry.range_max
    yield Workload(
        "smooth", ("wall_smoothing",), case,
        partial(smoothed, scan.ranges, step, 0.1, range_max), beams, "beams",
    )  # fmt: skip
    ray_length = config.sensor.missing_data_ray_length
    yield Workload(
        "hide", ("slanting_walls",), case,
        partial(without_hidden, scan.ranges, step, 0.1, range_max, ray_length), beams, "beams",
    )  # fmt: skip
    thinning = config.local_slam.adaptive_voxel_filter
    yield Workload(
        "thin", ("voxel_filter",), case,
        partial(thin, data.returns, thinning), len(data.returns), "points",
    )  # fmt: skip
    yield Workload(
        "far", ("order_statistics",), case,
        partial(distance_quantile, data.returns, 0.8), len(data.returns), "points",
    )  # fmt: skip
    moved = scan.ranges + 0.04
    yield Workload(
        "changed", ("changed_ranges",), case,
        partial(
            any_changed, scan.ranges, moved, range_max, range_max, (0.05, 0.03, 4.0), (0.0, 0.0)
        ),
        beams, "beams",
    )  # fmt: skip
    yield Workload(
        "chords", ("wall_chords",), case,
        partial(chord_ratio, data.returns, math.inf), len(data.returns), "points",
    )  # fmt: skip
    yield Workload(
        "isolated", ("near_neighbours", "order_statistics"), case,
        partial(without_isolated, data.returns), len(data.returns), "points",
    )  # fmt: skip
    yield Workload(
        "people", ("free_standing",), case,
        partial(are_free_standing, data.returns), len(data.returns), "points",
    )  # fmt: skip
    yield Workload(
        "outline", ("outline_distance",), case,
        partial(num_changed, data.returns + 0.05, data.returns[:-1], data.returns[1:]),
        len(data.returns), "points",
    )  # fmt: skip
    sensor = compose(tf_local_tracking, data.tf_tracking_sensor)
    returns = moved_points(*tf_local_tracking, data.returns)
    misses = moved_points(*tf_local_tracking, data.misses)
    yield Workload(
        "move", ("moved_points",), case,
        partial(moved_points, *tf_local_tracking, data.returns), len(data.returns), "points",
    )  # fmt: skip
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
        submaps = config.local_slam.submaps
        cells = cells_with_walls(sensor, returns, misses, submaps, are_hidden=True)
        insert_cells(submap.grid, cells, submaps, origin)

    yield Workload(
        "insert",
        ("scan_insertion", "wall_joints", "behind_walls", "ray_casting", "grid_update"),
        case, insert, rays, "rays",
    )  # fmt: skip


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
        "match", ("match_batch", "scan_residuals", "smooth_map", "wall_directions"), case,
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


def _wall_step(driven: Drive) -> Workload:
    """Return the comparison of a scan with the one before along the walls."""
    config = driven.config.local_slam.wall_step.model_copy(update={"max_ratio": 1.0})
    data = RangeFilter(driven.config.sensor).apply(driven.scans[-1])
    wall_step, moved = WallStep(config), Pose(0.2, 0.0, 0.0)
    wall_step.add(0.0, Pose(0.0, 0.0, 0.0), data.tf_tracking_sensor, data.returns)
    return Workload(
        "wall step", ("outline_lines", "outline_shift"), {"input": driven.name},
        partial(wall_step.better_pose, 0.2, moved, data.returns), len(data.returns), "points",
    )  # fmt: skip


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


def _submap_workloads(driven: Drive) -> Iterator[Workload]:
    """Yield the steps that finish a submap, and the search for a scan in it."""
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
    matcher = SubmapMatcher(grid)
    middle = len(own) // 2
    search_for = partial(
        matcher.match,
        linear_window=7.0, angular_window=math.radians(30.0), min_score=search.min_score,
    )  # fmt: skip
    off = compose(in_submap[middle], Pose(2.0, -1.5, 0.2))
    for name, estimate, cloud in (("hit", off, own[middle].points), ("miss", off, driven.points)):
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


def _growing(driven: Drive) -> Submap:
    assert driven.growing is not None
    return driven.growing
