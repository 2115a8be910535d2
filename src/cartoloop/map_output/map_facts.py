# SPDX-License-Identifier: Apache-2.0
"""What a user asks of a map first: extent, area, length of the way, resolution, verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass, replace
from typing import TypeVar

from cartoloop.map_data import MapData
from cartoloop.map_output.main_part import main_path, main_submaps
from cartoloop.map_output.occupancy_map import OccupancyMap, compose_map
from cartoloop.map_output.surveyed_floor import Extent, surveyed

AnyMap = TypeVar("AnyMap", bound=MapData)

SURVEYED = "surveyed"
"""Key in the report of a saved map: extent and area of its floor."""


@dataclass(frozen=True, slots=True)
class MapFacts:
    """The facts of a map, for people.

    Attributes
    ----------
    name : of the recording, "" for a live source.
    finished : whether the run came to its end, with the last pass: neither stopped nor failed.
    extent : what was surveyed, walls and path included, without what single rays saw; None if
        nothing was.
    area_m2 : of the free floor in it [m^2].
    path_length_m : length of the way [m].
    duration_s : recorded time from the first scan to the last [s].
    scans : number of scans read.
    loop_closures : in the graph.
    resolution : edge of a cell [m].
    verdict : good, doubtful or wrong; unknown where the map was not examined.
    """

    name: str
    finished: bool
    extent: Extent | None
    area_m2: float
    path_length_m: float
    duration_s: float
    scans: int
    loop_closures: int
    resolution: float
    verdict: str

    def described(self) -> list[tuple[str, str]]:
        """Return the facts of the map as names and values for people, in the order to show them."""
        box = self.extent
        verdict = "not examined" if self.verdict == "unknown" else self.verdict
        if not self.finished:
            verdict += ": mapping was stopped"
        return [
            ("extent", "nothing" if box is None else f"{box.width:.1f} m × {box.height:.1f} m"),
            ("floor area", f"{_rounded(self.area_m2)} m²"),
            ("length of the way", f"{_rounded(self.path_length_m)} m"),
            ("resolution", f"{100.0 * self.resolution:g} cm"),
            ("verdict", verdict),
        ]

    def caption(self) -> list[str]:
        """Return the name and the facts in parts for the head of a picture, whose font is small."""
        parts = [self.name, *map(" ".join, self.described())]
        return [part.replace("×", "x").replace("m²", "sq m") for part in parts if part]


def _rounded(value: float) -> str:
    """Return a number as exact as is of use to people."""
    return f"{value:,.{0 if value >= 100.0 else 1}f}"


def map_facts(result: MapData, occupancy_map: OccupancyMap | None = None) -> MapFacts:
    """Return the facts of a map.

    Parameters
    ----------
    result : the map, as `cartoloop.load_map` returns it.
    occupancy_map : composed of it, where that was already done; it takes a second for a large one.

    Raises
    ------
    OutputError
        The map is too large to be composed.
    """
    if occupancy_map is None:
        submaps = result.config.local_slam.submaps
        occupancy_map = compose_map(*main_submaps(result), submaps)
    free_below = result.config.map_output.free_thresh
    extent, area_m2 = surveyed(occupancy_map, free_below, main_path(result)[:, :2])
    return _facts(result, extent, area_m2, occupancy_map.resolution)


def _facts(result: MapData, extent: Extent | None, area_m2: float, resolution: float) -> MapFacts:
    report = result.report
    return MapFacts(
        name=report.input.name,
        finished=report.finished,
        extent=extent,
        area_m2=area_m2,
        path_length_m=report.input.path_length_m,
        duration_s=report.input.duration_s,
        scans=report.input.scans,
        loop_closures=result.graph.num_loop_closures,
        resolution=resolution,
        verdict=report.quality.verdict,
    )


def saved_facts(result: MapData) -> MapFacts | None:
    """Return the facts of a map as they were when it was saved; None where they are not known.

    Those of a map that was edited since are not.
    """
    saved = result.report.extra.get(SURVEYED)
    if not isinstance(saved, Mapping) or result.original is not None or result.edits:
        return None
    try:
        box = saved["extent"]
        extent = None if box is None else Extent(*(float(side) for side in box))
        area_m2 = float(saved["area_m2"])
    except (KeyError, TypeError, ValueError):
        return None
    return _facts(result, extent, area_m2, result.config.local_slam.submaps.resolution)


def with_surveyed(result: AnyMap, facts: MapFacts) -> AnyMap:
    """Return a map whose report says what was surveyed, so that it is not searched for again."""
    box = None if facts.extent is None else list(astuple(facts.extent))
    extra = result.report.extra | {SURVEYED: {"extent": box, "area_m2": facts.area_m2}}
    return replace(result, report=replace(result.report, extra=extra))
