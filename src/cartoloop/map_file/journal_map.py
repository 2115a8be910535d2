# SPDX-License-Identifier: Apache-2.0
"""The journal of a run that was interrupted, or goes on, as the map that it had so far.

Nodes, finished submaps and closures are as they were. Poses follow from the last adjustment and
from another one here. The submaps that were not finished are made again of the points that their
nodes keep, so they are a little sparser than they were. A run that adds a session to a map opens
as both together, as far as they were joined; without that map, as the session alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import Config, SubmapConfig
from cartoloop.earlier_sessions import EarlierMaps, whole_trajectory, with_parts
from cartoloop.errors import CartoloopError
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust
from cartoloop.global_slam.pose_graph import ClosureConstraints, ConstraintKind, PoseGraph
from cartoloop.global_slam.sessions import NodeSubmaps
from cartoloop.global_slam.trajectory import path_length
from cartoloop.map_data import MapData
from cartoloop.map_file.damage import damage_reported
from cartoloop.map_file.journal_records import JournalRecords
from cartoloop.map_file.map_digest import map_digest
from cartoloop.map_file.run_header import RunHeader, read_journal
from cartoloop.report import InputSummary, Report, summarize_constraints
from cartoloop.sensor.pose import (
    Pose,
    compose,
    compose_all,
    relative,
    relative_all,
    transform_points,
)
from cartoloop.session import whole_map
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.node import information_in_begun
from cartoloop.submaps.probability_grid import ProbabilityGrid, cells_with_walls, insert_cells

OpenBase = Callable[[Path], MapData]
"""Opens the map that a run adds a session to."""


def read_journal_map(path: Path, open_base: OpenBase | None = None) -> MapData:
    """Return the map in a journal, as far as it goes.

    Parameters
    ----------
    open_base : of a run that adds a session to a map; None: the session alone is wanted.

    Raises
    ------
    InputError
        It cannot be read, is damaged, or is of a newer program.
    """
    header, content = read_journal(path)
    base = None if open_base is None else base_of(header, path.parent, open_base)
    with damage_reported(path):
        earlier = EarlierMaps([] if base is None else [base])
        mapped = earlier.mapped
        collected = JournalRecords(content.size, header, mapped[0] if mapped else None)
        for record in content.records:
            collected.add(record)
        return _map_of(collected, header, earlier)


def base_of(header: RunHeader, folder: Path, open_base: OpenBase) -> MapData | None:
    """Return the map that a run adds to; None if there is none, or not as it was any more.

    Parameters
    ----------
    header : of the journal, which is in `folder`.
    """
    if header.base is None or (path := header.base.place(folder)) is None:
        return None
    try:
        base = open_base(path)
    except CartoloopError:  # it was removed or damaged: the session is worth having alone
        return None
    is_same = map_digest(base) == header.base.digest
    counts = (base.graph.num_nodes, base.graph.num_submaps)
    return base if is_same and counts == (header.first_node, header.first_submap) else None


def _map_of(collected: JournalRecords, header: RunHeader, earlier: EarlierMaps) -> MapData:
    config, closures = header.config, collected.closures
    graph = _graph(collected, config)
    own_scans = np.array(collected.node_scans, dtype=np.int64) + len(earlier.stamps)
    node_scans = np.concatenate((earlier.node_scan_index, own_scans))
    own_stamps = np.array([scan.stamp for scan in collected.scans])
    own_local = np.array([scan.tf_local_tracking for scan in collected.scans]).reshape(-1, 3)
    stamps = np.concatenate((earlier.stamps, own_stamps))
    local = np.concatenate((earlier.local_poses, own_local))
    [session] = whole_map(*header.recording, own_stamps)
    session = replace(
        session,
        first_scan=len(earlier.stamps),
        first_node=collected.num_nodes_before,
        first_submap=collected.num_submaps_before,
        calibration=collected.calibration,
    )
    sessions = with_parts([*earlier.sessions, session], collected.loaded.ranges)
    trajectory = whole_trajectory(sessions, local, node_scans, graph.node_poses)
    duration = float(np.ptp(own_stamps)) if len(own_stamps) else 0.0
    length = path_length(trajectory[len(earlier.stamps) :])
    report = Report(
        input=earlier.summary(InputSummary(header.name, len(own_stamps), duration, length)),
        nodes=graph.num_nodes,
        submaps=graph.num_submaps,
        constraints=summarize_constraints(graph, closures),
        skipped=earlier.skipped({}),
        version=header.program,
        fingerprint=header.fingerprint,
        extra=closures.summary(),
    )
    grids = [grid for each in earlier.maps for grid in each.submap_grids]
    points = [points for each in earlier.maps for points in each.node_points]
    return MapData(
        stamps=stamps,
        trajectory=trajectory,
        local_trajectory=local,
        graph=graph,
        node_scan_index=node_scans,
        submap_grids=grids + _grids(collected, config.local_slam.submaps),
        config=config,
        report=report,
        closures=closures,
        node_points=points + [node.points for node in collected.nodes],
        sessions=sessions,
    )


def _graph(collected: JournalRecords, config: Config) -> PoseGraph:
    """Return the adjusted graph."""
    graph, options = collected.loaded.graph, config.global_slam.pose_adjustment
    poses, first = collected.submap_poses, collected.num_submaps_before
    _move(graph, poses[:first])
    graph.add_submaps(poses[first:])
    if graph.num_submaps and not first:
        graph.fix_submap(0)
    begun: set[int] = set()
    for node in collected.nodes:
        informations = [
            node.information if index in begun else information_in_begun(node.information)
            for index, *_ in node.submaps
        ]
        begun.update(index for index, *_ in node.submaps)
        inside = [
            relative(collected.origins[index], node.tf_local_tracking) for index, *_ in node.submaps
        ]
        oldest = Pose(*poses[first + node.submaps[0][0]].tolist())
        graph.add_nodes(compose(oldest, inside[0]))
        graph.add_constraints(
            ConstraintKind.INTRA_SUBMAP,
            [first + index for index, *_ in node.submaps],
            [collected.num_nodes_before + node.number for _ in node.submaps],
            inside,
            [options.intra_submap_weight * information for information in informations],
        )
    closures = collected.closures
    for found, is_trusted in collected.found:
        submap, node_of = closures.submap[found.row], closures.node[found.row]
        constraints = ClosureConstraints(
            found.row, submap, node_of, found.tf_submap_node, found.information
        )
        graph.add_loop_closures(constraints, are_trusted=is_trusted)
    if collected.found:
        adjust(
            graph,
            AdjustmentOptions(
                loss=options.loss,
                loss_scale=options.loss_scale,
                max_iterations=options.max_num_final_iterations,
                relative_tolerance=options.tolerance,
                chain_share=options.mapping_share,
                flexible_share=options.flexible_share,
            ),
        )
    return graph


def _move(graph: PoseGraph, submap_poses: FloatArray) -> None:
    """Give submaps other poses, and move the nodes with those that they were inserted into."""
    if not len(submap_poses):
        return
    own = NodeSubmaps.of(graph).first
    inside = relative_all(graph.submap_poses[own], graph.node_poses)
    graph.submap_poses[:] = submap_poses
    graph.node_poses[:] = compose_all(submap_poses[own], inside)


def _grids(collected: JournalRecords, config: SubmapConfig) -> list[FinishedGrid]:
    """Return the grids of all submaps."""
    grids = []
    for index in range(len(collected.origins)):
        grid = collected.grids.get(index)
        grids.append(_unfinished(index, collected, config) if grid is None else grid)
    return grids


def _unfinished(index: int, collected: JournalRecords, config: SubmapConfig) -> FinishedGrid:
    """Return the grid of a submap that was not finished, made of the points of its nodes."""
    r, tf_local_submap = config.resolution, collected.origins[index]
    lattice = round(tf_local_submap.x / r), round(tf_local_submap.y / r)
    grid = ProbabilityGrid(r)
    nothing = np.zeros((0, 2))
    for node in collected.nodes:
        if all(number != index for number, *_ in node.submaps):
            continue
        pose = node.tf_local_tracking
        x, y = node.origin.tolist()
        points = transform_points(pose, node.points)
        tf_local_sensor = compose(pose, Pose(x, y, 0.0))
        cells = cells_with_walls(tf_local_sensor, points, nothing, config, are_hidden=False)
        before = grid.cells.size
        insert_cells(grid, cells, config, lattice)
        collected.count_cells(grid.cells.size - before)
    return grid.finish()
