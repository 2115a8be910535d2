# SPDX-License-Identifier: Apache-2.0
"""A finished map drawn again: with other cells, a part of it, or turned; without mapping again.

The map is composed again of the submaps at their adjusted poses, not of its pixels. Cells smaller
than those of the submaps interpolate what the submaps know of a place, which is most where many of
them overlap; they hold no more than that. Larger cells are walls where any part of them is one.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TypeVar

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import ConfigError
from cartoloop.map_data import MapData
from cartoloop.map_file.file_set import replaced_files, require_no_map_file
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.map_output.closures_file import closures_csv, nodes_csv
from cartoloop.map_output.main_part import main_scans, main_submaps
from cartoloop.map_output.map_facts import map_facts
from cartoloop.map_output.map_files import pgm_bytes, yaml_text
from cartoloop.map_output.occupancy_map import UNKNOWN, CellBox, OccupancyMap, compose_map
from cartoloop.map_output.output_folder import prepare_folder
from cartoloop.map_output.picture import DEFAULT_LAYERS, Layer, MapPicture
from cartoloop.map_output.save import png_bytes, write_file
from cartoloop.map_output.surveyed_floor import Extent
from cartoloop.map_output.text_files import g2o_text, tum_text
from cartoloop.sensor.pose import Pose, compose_all, transform_points

FORMATS = ("png", "pgm", "tum", "g2o", "csv")
"""What can be exported: the picture, the map for ROS with its YAML file, the trajectories, the pose
graph, and the tables of nodes and closures."""

_FILE_FORMATS = {".png": "png", ".pgm": "pgm", ".yaml": "pgm", ".tum": "tum", ".g2o": "g2o"}
"""Formats of single files, by their ending."""

MAX_CELL_M = 1000.0
"""Largest edge of a cell [m]: a map of such cells shows nothing."""

_WALL = 0.5
"""Cells more probably occupied than this are walls."""

_SURROUNDINGS_M = 0.5
"""What is shown around the surveyed part [m]."""

AnyMap = TypeVar("AnyMap", bound=MapData)


@dataclass(frozen=True, slots=True)
class Drawing:
    """How a map is drawn; by default as mapping drew it.

    Attributes
    ----------
    resolution : edge of a cell [m]; None: that of the submaps.
    crop : the part to draw [m, map frame as turned]; None: all.
    turn : angle by which the map is turned about its origin, counter-clockwise [rad].
    layers : drawn over the picture.
    """

    resolution: float | None = None
    crop: Extent | None = None
    turn: float = 0.0
    layers: Collection[Layer] = DEFAULT_LAYERS


def export_map(
    result: MapData,
    out: str | PathLike[str],
    drawing: Drawing | None = None,
    formats: Collection[str] = FORMATS,
) -> list[Path]:
    """Draw a map again and write it; return the files written.

    Several files replace those of an earlier export as one.

    Parameters
    ----------
    result : the map, as `cartoloop.load_map` returns it.
    out : folder, which is created; or one file whose ending names its format, whatever `formats`.
    drawing : how it is drawn. Trajectory and graph are turned, but not cropped.
    formats : of :data:`FORMATS`.

    Raises
    ------
    ConfigError
        There is no such format, nothing lies in the part to draw, or a number is impossible.
    OutputError
        A file cannot be written, or the map is too large.
    """
    drawing, path = drawing or Drawing(), Path(out)
    if unknown := sorted(set(formats).difference(FORMATS)):
        raise ConfigError(f"no format '{unknown[0]}': choose from {', '.join(FORMATS)}")
    single = _FILE_FORMATS.get(path.suffix.lower())
    if single is None:
        if (
            path.suffix
            and not path.is_dir()
            and len(path.suffix) <= 5
            and path.suffix[1:].isalpha()
        ):
            endings = ", ".join(sorted(_FILE_FORMATS))
            raise ConfigError(f"{path}: unknown ending; name a folder, or a file with {endings}")
        if (path / FILE_NAME).exists():
            raise ConfigError(
                f"{path}: holds a map, whose files would no longer belong together; export into "
                "another folder"
            )
    else:
        require_no_map_file(path)
    turned_map = turned(result, drawing.turn)
    stem = None if single is None else path.stem
    # All of it first: nothing is created for a map that cannot be drawn.
    files = dict(_files(turned_map, drawing, [single] if single else formats, stem))
    folder = prepare_folder(path if single is None else path.parent)
    if len(files) == 1:
        [(name, content)] = files.items()
        write_file(folder / name, content)
    elif files:
        with replaced_files(folder) as beside:
            for name, content in files.items():
                write_file(beside / name, content)
    return [folder / name for name in files]


def turned(result: AnyMap, angle: float) -> AnyMap:
    """Return a map whose frame is turned: everything in it, by `angle` counter-clockwise [rad]."""
    if not math.isfinite(angle):
        raise ConfigError(f"cannot turn by {angle}: give an angle in degrees")
    if angle == 0.0:
        return result
    turn = np.array((0.0, 0.0, angle))
    graph = result.graph.copy()
    graph.submap_poses[:] = compose_all(turn, graph.submap_poses)
    graph.node_poses[:] = compose_all(turn, graph.node_poses)
    places = []
    for place in result.report.quality.places:
        x, y = transform_points(Pose(*turn), np.array([(place.x, place.y)]))[0].tolist()
        places.append(replace(place, x=x, y=y))
    quality = replace(result.report.quality, places=tuple(places))
    return replace(
        result,
        graph=graph,
        trajectory=compose_all(turn, result.trajectory),
        local_trajectory=compose_all(turn, result.local_trajectory),
        report=replace(result.report, quality=quality),
    )


def surveyed_part(result: MapData, turn: float = 0.0) -> Extent | None:
    """Return the part of a map, turned by an angle [rad], without what only stray rays saw.

    None where nothing was surveyed.
    """
    extent = map_facts(turned(result, turn)).extent
    if extent is None:
        return None
    left, bottom = extent.left - _SURROUNDINGS_M, extent.bottom - _SURROUNDINGS_M
    right, top = extent.right + _SURROUNDINGS_M, extent.top + _SURROUNDINGS_M
    return Extent(*(round(side, 3) for side in (left, bottom, right, top)))


def angle_to_axes(result: MapData) -> float:
    """Return by how much to turn a map so that most walls lie along its axes, in ±45° [rad].

    The sum of squares of the walls' projections onto the axes is greatest where walls are seen from
    their end.
    """
    occupancy_map = compose_again(result)
    rows, cols = np.nonzero(occupancy_map.probability > _WALL)
    if len(rows) == 0:
        return 0.0
    cells = np.column_stack((cols, rows)).astype(np.float64)
    cells -= cells.mean(axis=0)
    coarse = np.arange(-45.0, 45.0, 0.5)
    best = coarse[np.argmax([_alignment(cells, math.radians(a)) for a in coarse])]
    fine = best + np.arange(-0.5, 0.55, 0.05)
    best = fine[np.argmax([_alignment(cells, math.radians(a)) for a in fine])]
    return math.radians(round(best, 2)) + 0.0  # no -0.0


def _alignment(cells: FloatArray, angle: float) -> float:
    """Return how much of the cells (n, 2), turned by an angle [rad], lies in few rows, columns."""
    total = 0.0
    for along in ((math.cos(angle), -math.sin(angle)), (math.sin(angle), math.cos(angle))):
        place = np.rint(cells @ np.array(along)).astype(np.int64)
        total += float(np.sum(np.bincount(place - place.min()).astype(np.float64) ** 2))
    return total


def compose_again(
    result: MapData, resolution: float | None = None, crop: Extent | None = None
) -> OccupancyMap:
    """Return the occupancy map of a map's submaps with cells of any size.

    Parameters
    ----------
    result : the map.
    resolution : edge of a cell [m]; None: that of the submaps.
    crop : the part to compose [m, map frame], extended to whole cells; None: all that was seen.

    Raises
    ------
    ConfigError
        The resolution or the part is impossible, or nothing was seen in it.
    OutputError
        The map is too large.
    """
    submaps = result.config.local_slam.submaps
    if resolution is None:
        resolution = submaps.resolution
    if not 0.0 < resolution <= MAX_CELL_M:
        raise ConfigError(f"a resolution of {resolution:g} m is impossible: give one like 0.05")
    # Larger cells are made of whole ones that are no larger than those of the submaps.
    per_cell = max(1, math.ceil(resolution / submaps.resolution - 1e-9))
    config = submaps.model_copy(update={"resolution": resolution / per_cell})
    box = None if crop is None else _box(crop, resolution, per_cell)
    grids, poses = main_submaps(result)
    occupancy_map = compose_map(grids, poses, config, box)
    if crop is not None and not np.any(occupancy_map.probability >= 0.0):
        whole = compose_map(grids, poses, submaps)
        right, top = np.array(whole.probability.shape[::-1]) * whole.resolution
        raise ConfigError(
            f"nothing was seen from x {crop.left:g} to {crop.right:g} m, y {crop.bottom:g} to "
            f"{crop.top:g} m: the map is from x {whole.origin_x:.1f} to "
            f"{whole.origin_x + right:.1f} m, y {whole.origin_y:.1f} to "
            f"{whole.origin_y + top:.1f} m"
        )
    return occupancy_map if per_cell == 1 else _with_larger_cells(occupancy_map, per_cell)


def _files(
    result: MapData, drawing: Drawing, formats: Collection[str], stem: str | None
) -> Iterator[tuple[str, str | bytes]]:
    """Yield names and contents of files; `stem`: their name where there is one of a format."""
    if "pgm" in formats or "png" in formats:
        occupancy_map = compose_again(result, drawing.resolution, drawing.crop)
        options, name = result.config.map_output, stem or "map"
        if "pgm" in formats:
            yield f"{name}.pgm", pgm_bytes(occupancy_map, options)
            yield f"{name}.yaml", yaml_text(occupancy_map, options, f"{name}.pgm")
        if "png" in formats:
            caption = _caption(result, occupancy_map, drawing.crop)
            picture = MapPicture(occupancy_map, caption, is_part=drawing.crop is not None)
            yield f"{name}.png", png_bytes(result, picture, drawing.layers)
    if "tum" in formats:
        scans = main_scans(result)
        stamps, local = result.stamps[scans], result.local_trajectory[scans]
        yield f"{stem or 'trajectory'}.tum", tum_text(stamps, result.trajectory[scans])
        if stem is None:
            yield "local_trajectory.tum", tum_text(stamps, local)
    if "g2o" in formats:
        yield f"{stem or 'graph'}.g2o", g2o_text(result.graph)
    if "csv" in formats:
        yield "nodes.csv", nodes_csv(result)
        yield "closures.csv", closures_csv(result)


def _caption(result: MapData, occupancy_map: OccupancyMap, crop: Extent | None) -> list[str]:
    facts = map_facts(result, occupancy_map)
    if crop is None:
        return facts.caption()
    part = (
        f"x {crop.left:g} to {crop.right:g} m, y {crop.bottom:g} to {crop.top:g} m",
        f"resolution {100.0 * occupancy_map.resolution:g} cm",
    )
    return [facts.name, *part] if facts.name else [*part]


def _box(crop: Extent, resolution: float, per_cell: int) -> CellBox:
    """Return the smaller cells of all whole cells that a part of the map touches."""
    sides: FloatArray = np.array((crop.left, crop.bottom, crop.right, crop.top))
    if not np.isfinite(sides).all() or crop.width <= 0.0 or crop.height <= 0.0:
        raise ConfigError(
            f"{crop.left:g},{crop.bottom:g},{crop.right:g},{crop.top:g} is no part of a map: give "
            "left, bottom, right and top in metres, the smaller first"
        )
    # Sides that lie on a cell's edge are not moved by their last digit.
    first = np.floor(sides[:2] / resolution + 1e-6).astype(np.int64) * per_cell
    end = np.ceil(sides[2:] / resolution - 1e-6).astype(np.int64) * per_cell
    return CellBox(int(first[0]), int(first[1]), int(end[0]), int(end[1]))


def _with_larger_cells(fine: OccupancyMap, per_cell: int) -> OccupancyMap:
    """Return a map of cells of `per_cell` by `per_cell` cells of another.

    A cell is a wall as surely as the surest wall in it; otherwise the mean of what is known of it.
    """
    origin_col = round(fine.origin_x / fine.resolution)
    origin_row = round(fine.origin_y / fine.resolution)
    num_rows, num_cols = fine.probability.shape
    before_row, before_col = origin_row % per_cell, origin_col % per_cell
    padding = (
        (before_row, -(before_row + num_rows) % per_cell),
        (before_col, -(before_col + num_cols) % per_cell),
    )
    padded = np.pad(fine.probability, padding, constant_values=UNKNOWN)
    rows, cols = padded.shape[0] // per_cell, padded.shape[1] // per_cell
    blocks = padded.reshape(rows, per_cell, cols, per_cell)
    known = blocks >= 0.0
    count = known.sum(axis=(1, 3))
    mean = np.where(known, blocks, 0.0).sum(axis=(1, 3)) / np.maximum(count, 1)
    surest = blocks.max(axis=(1, 3))
    probability = np.where(surest > _WALL, surest, mean)
    resolution = fine.resolution * per_cell
    return OccupancyMap(
        probability=np.where(count > 0, probability, UNKNOWN).astype(np.float32),
        origin_x=(origin_col - before_col) // per_cell * resolution,
        origin_y=(origin_row - before_row) // per_cell * resolution,
        resolution=resolution,
    )
