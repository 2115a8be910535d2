# SPDX-License-Identifier: Apache-2.0
"""The edits of a map, applied to it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.map_data import MapData, input_left
from cartoloop.map_editing.arguments import (
    Add,
    Align,
    Arguments,
    ControlPoints,
    Drop,
    ForgetArea,
    ForgetTime,
    Pin,
    Rename,
    Split,
    checked,
)
from cartoloop.map_editing.descriptions import described
from cartoloop.map_editing.removal import (
    Kept,
    closures_left,
    graph_left,
    kept_of,
    own_positions,
    without_areas,
    without_nodes,
)
from cartoloop.map_editing.rigid_fit import PointFit
from cartoloop.map_editing.sessions import sessions_left, trajectory_of
from cartoloop.map_editing.working_map import WorkingMap
from cartoloop.quality.verdict import Quality
from cartoloop.report import Report, summarize_constraints
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.submaps.finished_grid import FinishedGrid

AnyMap = TypeVar("AnyMap", bound=MapData)


@dataclass(frozen=True, eq=False, slots=True)
class Applied(Generic[AnyMap]):
    """A map with its edits applied.

    Attributes
    ----------
    map : the edited map; the map as mapped itself where no edit is in force.
    kept : which scans, nodes and submaps of the map as mapped its own are, in their order.
    tf_map_original : by how much the map as a whole was moved.
    session_begins : of each session of the map its first scan in the map as mapped.
    fits : of control points, by the number of the edit.
    """

    map: AnyMap
    kept: Kept
    tf_map_original: Pose
    session_begins: tuple[int, ...]
    fits: dict[int, PointFit] = field(default_factory=dict)

    @property
    def map_as_mapped(self) -> MapData:
        """The map without its edits."""
        return self.map if self.map.original is None else self.map.original

    def scans_as_mapped(self, session: int) -> tuple[int, int]:
        """Return the first scan of a session of the map, and its end, in the map as mapped."""
        mapped, first = self.map_as_mapped, self.session_begins[session]
        # A session that is left out begins after others, too.
        begins = [*self.session_begins, *(one.first_scan for one in mapped.sessions)]
        return first, min([each for each in begins if each > first], default=len(mapped.stamps))


def apply_edits(original: AnyMap, quality: Quality | None = None) -> Applied[AnyMap]:
    """Return a map with the edits applied that are not undone, in their order.

    Parameters
    ----------
    original : the map as mapped, with all its edits.
    quality : the verdict on the edited map; None where it was not examined.

    Raises
    ------
    ValueError, IndexError
        The arguments of an edit are damaged.
    """
    begins = tuple(session.first_scan for session in original.sessions)
    arguments = [checked(edit, original) for edit in original.edits]
    in_force = [number for number, edit in enumerate(original.edits) if not edit.is_undone]
    if not in_force:
        return Applied(original, _all_of(original), IDENTITY, begins)
    working, fits = WorkingMap(original), {}
    for number in in_force:
        fit = apply_one(working, arguments[number])
        if fit is not None:
            fits[number] = fit
    working.adjust()
    return _finished(original, working, quality, fits)


def apply_one(working: WorkingMap, arguments: Arguments) -> PointFit | None:
    """Apply one edit; return how control points fit."""
    match arguments:
        case Drop():
            working.drop(arguments.pairs)
        case Add():
            working.add(arguments)
        case Pin():
            working.pin(arguments.submap, arguments.node, Pose(*arguments.pose))
        case ControlPoints():
            points = arguments.points
            return working.move_to_points(
                np.array([point.node for point in points]),
                np.array([point.place for point in points]),
                np.array([point.surveyed for point in points]),
            )
        case Align():
            working.turn_to(arguments.angle)
        case ForgetTime():
            working.forget_time(arguments)
        case ForgetArea():
            working.forget_area(arguments)
        case Split():
            working.split(arguments.scan, arguments.name)
        case Rename():
            working.rename(arguments.scan, arguments.name)
    return None


def _finished(
    original: AnyMap,
    working: WorkingMap,
    quality: Quality | None,
    fits: dict[int, PointFit],
) -> Applied[AnyMap]:
    """Return the map that the edits have made, without what is forgotten."""
    kept = kept_of(working.graph, original.node_scan_index, working.is_forgotten)
    graph, closures, sessions = working.graph, working.closures, working.sessions
    begins = tuple(session.first_scan for session in sessions)
    trajectory = trajectory_of(original, graph.node_poses)
    if working.is_forgotten.any():
        closures, rows = closures_left(closures, kept, graph)
        graph = graph_left(graph, kept, rows)
        sessions, begins = sessions_left(sessions, kept, original.stamps[kept.scans])
    places = np.full(len(original.stamps), -1, dtype=np.int64)
    places[kept.scans] = np.arange(len(kept.scans))
    changed = replace(
        original,
        stamps=original.stamps[kept.scans],
        trajectory=trajectory[kept.scans],
        local_trajectory=original.local_trajectory[kept.scans],
        graph=graph,
        closures=closures,
        node_scan_index=places[original.node_scan_index[kept.nodes]],
        submap_grids=_grids(original, working, kept),
        node_points=_points(original, working, kept.nodes),
        sessions=sessions,
        original=original,
    )
    report = _report(original, changed, quality)
    changed = replace(changed, report=report)
    return Applied(changed, kept, working.tf_map_original, begins, fits)


def _report(original: MapData, edited: MapData, quality: Quality | None) -> Report:
    report, graph = edited.report, edited.graph
    edits = [described(edit) for edit in original.edits if not edit.is_undone]
    return replace(
        report,
        input=input_left(original, edited),
        nodes=graph.num_nodes,
        submaps=graph.num_submaps,
        constraints=summarize_constraints(graph, edited.closures),
        quality=quality or Quality(),
        extra=report.extra | {"edits": edits},
    )


def _grids(original: MapData, working: WorkingMap, kept: Kept) -> list[FinishedGrid]:
    grids = []
    is_forgotten = working.is_forgotten[original.node_scan_index]
    for submap in kept.submaps.tolist():
        grid = original.submap_grids[submap]
        if is_forgotten.any():
            nodes, positions = own_positions(original.graph, submap)
            lost = is_forgotten[nodes]
            if lost.any() and not lost.all():
                grid = without_nodes(grid, positions[~lost], positions[lost])
        grids.append(without_areas(grid, working.areas.get(submap, ())))
    return grids


def _points(original: MapData, working: WorkingMap, nodes: IntArray) -> list[FloatArray]:
    """Return the points of nodes, without those in forgotten areas."""
    points = original.node_points
    if len(points) == 0:
        return []
    if working.is_erased is None:
        return [points[node] for node in nodes.tolist()]
    of_all = working.points
    before = np.concatenate(([0], np.cumsum(working.is_erased)))
    loses = before[of_all.ends] > before[of_all.firsts]
    left = []
    for node in nodes.tolist():
        some = slice(int(of_all.firsts[node]), int(of_all.ends[node]))
        own = of_all.points[some]
        left.append(own[~working.is_erased[some]] if loses[node] else own)
    return left


def _all_of(original: MapData) -> Kept:
    graph = original.graph
    return Kept(
        np.arange(len(original.stamps)), np.arange(graph.num_nodes), np.arange(graph.num_submaps)
    )
