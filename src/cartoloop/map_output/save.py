# SPDX-License-Identifier: Apache-2.0
"""Writes the files of a map into a folder, all of them or none."""

from __future__ import annotations

import io
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config_file import MACHINE_PARAMETERS, config_hash, config_toml
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.map_file import schema as map_file
from cartoloop.map_file.file_set import new_file_set, require_no_map_file
from cartoloop.map_file.write import map_bytes
from cartoloop.map_output.closures_file import closures_csv, nodes_csv
from cartoloop.map_output.main_part import main_path, main_scans, main_submaps
from cartoloop.map_output.map_facts import map_facts, with_surveyed
from cartoloop.map_output.map_files import pgm_bytes, yaml_text
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.map_output.output_folder import prepare_folder
from cartoloop.map_output.picture import DEFAULT_LAYERS, Layer, MapPicture
from cartoloop.map_output.text_files import g2o_text, tum_text
from cartoloop.map_output.unfinished_file import unfinished_file
from cartoloop.stop_request import StopRequest

if TYPE_CHECKING:
    from cartoloop.map_data import MapData
    from cartoloop.report import Report

_PNG_LEVEL = 3
"""How hard the picture is compressed: a twentieth larger than at the usual level, in two thirds of
the time."""


def save(
    result: MapData,
    out: str | PathLike[str],
    *,
    layers: Collection[Layer] = DEFAULT_LAYERS,
    origins: Mapping[str, str] | None = None,
    complete_report: Callable[[Report], Report] | None = None,
    stop: StopRequest | None = None,
    config_text: str | None = None,
) -> Report:
    """Write all files of a map into the folder `out`, creating it if necessary.

    They replace the files of a map that is there, all at once when the last is written; a failure
    or an interruption before keeps these.

    ``map.pgm``, ``map.yaml``, ``map.png``, ``trajectory.tum``, ``local_trajectory.tum``,
    ``graph.g2o``, ``nodes.csv``, ``closures.csv``, ``map.cartoloop``, ``config.toml`` and
    ``report.json``. The same map yields the same bytes, except in ``report.json``, which
    contains run times.

    Parameters
    ----------
    result : the map.
    out : the folder.
    layers : drawn over the map in ``map.png``.
    origins : by key of the configuration, where its value comes from.
    complete_report : returns the report to write, given the one so far, when all else is written.
    stop : of the run; while the files are replaced, it is only noted.
    config_text : content of ``config.toml``, as it was written before; None: it is made.

    Returns
    -------
    The report as written.

    Raises
    ------
    OutputError
        The folder or a file in it cannot be written, or the map is too large.
    """
    with new_file_set(prepare_folder(out), stop) as folder:
        result = _write_files(result, folder, layers)
        text = _config_text(result, origins) if config_text is None else config_text
        write_file(folder / "config.toml", text)
        report = replace(result.report, config_hash=config_hash(result.config))
        report = complete_report(report) if complete_report else report
        write_file(folder / "report.json", report.to_json())
    return report


def _write_files(result: MapData, folder: Path, layers: Collection[Layer]) -> MapData:
    """Write all files except the configuration and the report; return the map with its extent."""
    occupancy_map = compose_map(*main_submaps(result), result.config.local_slam.submaps)
    options = result.config.map_output
    write_file(folder / "map.pgm", pgm_bytes(occupancy_map, options))
    write_file(folder / "map.yaml", yaml_text(occupancy_map, options, "map.pgm"))
    facts = map_facts(result, occupancy_map)
    result = with_surveyed(result, facts)
    picture = MapPicture(occupancy_map, facts.caption())
    del occupancy_map  # free the largest array before the others are made
    write_file(folder / "map.png", png_bytes(result, picture, layers))
    del picture
    scans = main_scans(result)
    stamps, local = result.stamps[scans], result.local_trajectory[scans]
    write_file(folder / "trajectory.tum", tum_text(stamps, result.trajectory[scans]))
    write_file(folder / "local_trajectory.tum", tum_text(stamps, local))
    write_file(folder / "graph.g2o", g2o_text(result.graph))
    write_file(folder / "nodes.csv", nodes_csv(result))
    write_file(folder / "closures.csv", closures_csv(result))
    write_file(folder / map_file.FILE_NAME, map_bytes(result))
    return result


def _config_text(result: MapData, origins: Mapping[str, str] | None) -> str:
    toml = config_toml(result.config, origins, without=MACHINE_PARAMETERS)
    left_out = f"Without {', '.join(sorted(MACHINE_PARAMETERS))}: the result does not depend on it."
    return f"{toml}\n# {left_out}\n"


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file atomically: under a temporary name, then renamed.

    Raises
    ------
    OutputError
        It cannot be written; an existing file is kept.
    """
    data = content if isinstance(content, bytes) else content.encode("utf-8")
    with unfinished_file(path) as unfinished:
        unfinished.write_bytes(data)


def write_apart(path: Path, content: str | bytes) -> None:
    """Write a file as `write_file` does, but none of those of a map.

    Raises
    ------
    OutputError
        It cannot be written, or is a file of a map; an existing file is kept.
    """
    require_no_map_file(path)
    write_file(path, content)


def png_bytes(result: MapData, picture: MapPicture, layers: Collection[Layer]) -> bytes:
    """Return the picture of a map as a PNG file, with layers drawn over it."""
    picture.draw(
        trajectory=main_path(result) if "trajectory" in layers else None,
        closures=_closure_ends(result.graph) if "closures" in layers else None,
        places=result.report.quality.places if "quality" in layers else (),
    )
    buffer = io.BytesIO()
    picture.canvas.save(buffer, format="png", compress_level=_PNG_LEVEL)
    return buffer.getvalue()


def _closure_ends(graph: PoseGraph) -> FloatArray:
    """Return the positions of the submap and the node of each loop closure, shape (m, 4) [m]."""
    closures = graph.kinds == ConstraintKind.LOOP_CLOSURE
    return np.hstack(
        (
            graph.submap_poses[graph.index_a[closures], :2],
            graph.node_poses[graph.index_b[closures], :2],
        )
    )
