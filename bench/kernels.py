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
from bench.submap_kernels import submap_workloads
from bench.workload import Workload
from cartoloop.config import CorrelativeMatcherConfig
from cartoloop.errors import ConfigError
from cartoloop.global_slam.closure_search import FinishedSubmap, refine_all
from cartoloop.kernels.changed_ranges import any_changed
from cartoloop.kernels.moved_points import moved_points
from cartoloop.kernels.order_statistics import distance_quantile
from cartoloop.local_slam.wall_step import WallStep
from cartoloop.quality.scan_changes import num_changed
from cartoloop.scan_matching import correlative
from cartoloop.sensor.free_standing import are_free_standing
from cartoloop.sensor.isolated_returns import without_isolated
from cartoloop.sensor.pose import Pose, compose, relative
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
            yield from _return_workloads(driven)
            yield from _insert_workloads(driven)
            yield from _match_workloads(driven)
            yield _wall_step(driven)
            yield from submap_workloads(driven)
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
    """Yield local SLAM as a whole, and the steps that filter the ranges of a scan."""
    config = driven.config
    case: Case = {"input": driven.name}
    scan = driven.scans[-1]
    yield Workload(
        "local SLAM", (), case, partial(replay, driven.events), driven.num_replayed, "scans"
    )
    beams = scan.geometry.num_beams
    range_filter = RangeFilter(config.sensor)
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
    moved = scan.ranges + 0.04
    yield Workload(
        "changed", ("changed_ranges",), case,
        partial(
            any_changed, scan.ranges, moved, range_max, range_max, (0.05, 0.03, 4.0), (0.0, 0.0)
        ),
        beams, "beams",
    )  # fmt: skip


def _return_workloads(driven: Drive) -> Iterator[Workload]:
    """Yield what is made of the returns of a scan."""
    case: Case = {"input": driven.name}
    data = RangeFilter(driven.config.sensor).apply(driven.scans[-1])
    thinning = driven.config.local_slam.adaptive_voxel_filter
    yield Workload(
        "thin", ("voxel_filter",), case,
        partial(thin, data.returns, thinning), len(data.returns), "points",
    )  # fmt: skip
    yield Workload(
        "far", ("order_statistics",), case,
        partial(distance_quantile, data.returns, 0.8), len(data.returns), "points",
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


def _insert_workloads(driven: Drive) -> Iterator[Workload]:
    """Yield the steps that insert a scan into a submap."""
    config = driven.config
    case: Case = {"input": driven.name}
    tf_local_tracking = driven.poses[-1]
    data = RangeFilter(config.sensor).apply(driven.scans[-1])
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


def _growing(driven: Drive) -> Submap:
    assert driven.growing is not None
    return driven.growing
