# SPDX-License-Identifier: Apache-2.0
"""Several maps into one: their relative poses are found, not given."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from os import PathLike
from pathlib import Path

from cartoloop.arguments import as_path, shown
from cartoloop.config import Config
from cartoloop.earlier_sessions import EarlierMaps, whole_trajectory, with_parts
from cartoloop.errors import UsageError
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.map_data import MapData
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.map_repair import repair
from cartoloop.map_sessions import map_of, require_resolution
from cartoloop.part_check import part_check
from cartoloop.quality.examine import examine
from cartoloop.report import (
    AdjustmentSummary,
    InputSummary,
    Report,
    RunClock,
    summarize_constraints,
)
from cartoloop.result import Result
from cartoloop.runtime.stage_timer import StageTimer


def merge(
    maps: Iterable[MapData | str | PathLike[str]],
    config: Config | None = None,
    note: Callable[[str], None] | None = None,
) -> Result:
    """Return one map of the sessions of several, as far as their relative poses are found.

    What cannot be joined stays a part of its own: `Session.part` of the sessions states it, and
    ``report.extra["joins"]`` why. The frame is that of the first map. The maps do not change.

    >>> merged = cartoloop.merge(["monday", "tuesday"])
    >>> merged.save("both")

    Parameters
    ----------
    maps : at least two: maps, or paths of such.
    config : all parameters; by default those of the first map.
    note : called with a description of each step as it begins.

    Raises
    ------
    InputError
        A map cannot be read.
    UsageError
        There are fewer than two, one is given twice, or their submaps differ in resolution.
    """
    contents = [map_of(each, "merge: maps") for each in _several(maps)]
    config = config or contents[0].config
    for each in contents:
        require_resolution(each, config)
    clock, timer, earlier = RunClock(), StageTimer(), EarlierMaps(contents)
    slam = GlobalSlam(
        config.global_slam, timer, mapped=earlier.mapped, check_geometry=part_check(config)
    )

    def examined() -> Result:
        result = _result(slam, earlier, config, timer)
        if note is not None:
            note("examining the map")
        with timer.measure("examine"):
            quality = examine(result, config.quality)
        return replace(result, report=replace(result.report, quality=quality))

    try:
        slam.finish((), note)
        result = examined()
        if repair(slam, lambda: result, config, result.quality, note):
            result = examined()
    finally:
        slam.close()
    is_finished = slam.graph.num_nodes > 0
    report = replace(result.report, stages=timer.summary(), finished=is_finished)
    return replace(result, report=clock.timed(report))


def _several(maps: Iterable[MapData | str | PathLike[str]]) -> list[MapData | str | PathLike[str]]:
    if isinstance(maps, str | PathLike | MapData) or not isinstance(maps, Iterable):
        raise UsageError(f"merge: maps is {shown(maps)}: give a list of maps, or of their paths")
    several = list(maps)
    if len(several) < 2:
        given = "one map" if several else "no map"
        raise UsageError(f"merge: {given} given: give at least two")
    require_different(several)
    return several


def require_different(maps: Iterable[MapData | str | PathLike[str]]) -> None:
    """Check that no map is given twice.

    Raises
    ------
    UsageError
        One is; each of its scans would be in the merged map twice.
    """
    seen: set[Path | int] = set()
    for each in maps:
        if isinstance(each, MapData):
            place: Path | int = id(each)
            name = "a map"
        else:
            path = as_path(each, "merge: maps")
            place = (path.parent if path.name == FILE_NAME else path).resolve()
            name = str(path)
        if place in seen:
            raise UsageError(f"merge: {name} is given twice; give each map once")
        seen.add(place)


def _result(slam: GlobalSlam, earlier: EarlierMaps, config: Config, timer: StageTimer) -> Result:
    graph, sessions = slam.graph, with_parts(earlier.sessions, slam.sessions)
    trajectory = whole_trajectory(
        sessions, earlier.local_poses, earlier.node_scan_index, graph.node_poses
    )
    grids = slam.finished_grids()
    own = InputSummary(" + ".join(each.report.input.name for each in earlier.maps))
    report = Report(
        input=earlier.summary(own),
        nodes=graph.num_nodes,
        submaps=graph.num_submaps,
        constraints=summarize_constraints(graph, slam.closures),
        adjustment=AdjustmentSummary.of_runs(slam.adjustments),
        stages=timer.summary(),
        skipped=earlier.skipped({}),
        extra=slam.summary(),
    )
    return Result(
        earlier.stamps,
        trajectory,
        earlier.local_poses,
        graph,
        earlier.node_scan_index,
        [grids[index] for index in range(graph.num_submaps)],
        config,
        report,
        closures=slam.closures,
        node_points=slam.node_points,
        sessions=sessions,
    )
