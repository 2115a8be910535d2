# SPDX-License-Identifier: Apache-2.0
"""Writes the files of a map into a folder, each completely or not at all."""

from __future__ import annotations

import io
import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config_file import MACHINE_PARAMETERS, config_hash, config_toml
from cartoloop.errors import OutputError
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.map_file import schema as map_file
from cartoloop.map_file.write import map_bytes
from cartoloop.map_output.closures_file import closures_csv, nodes_csv
from cartoloop.map_output.map_facts import map_facts
from cartoloop.map_output.map_files import pgm_bytes, yaml_text
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.map_output.picture import DEFAULT_LAYERS, Layer, MapPicture
from cartoloop.map_output.text_files import g2o_text, tum_text
from cartoloop.map_output.unfinished_file import unfinished_file

if TYPE_CHECKING:
    from cartoloop.map_data import MapData
    from cartoloop.report import Report


def save(
    result: MapData,
    out: str | PathLike[str],
    *,
    layers: Collection[Layer] = DEFAULT_LAYERS,
    origins: Mapping[str, str] | None = None,
) -> None:
    """Write all files of a map into the folder `out`, creating it if necessary.

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

    Raises
    ------
    OutputError
        The folder or a file in it cannot be written, or the map is too large.
    """
    folder = prepare_folder(out)
    occupancy_map = compose_map(
        result.submap_grids, result.graph.submap_poses, result.config.local_slam.submaps
    )
    options = result.config.map_output
    write_file(folder / "map.pgm", pgm_bytes(occupancy_map, options))
    write_file(folder / "map.yaml", yaml_text(occupancy_map, options, "map.pgm"))
    picture = MapPicture(occupancy_map, map_facts(result, occupancy_map).caption())
    del occupancy_map  # free the largest array before the others are made
    write_file(folder / "map.png", png_bytes(result, picture, layers))
    del picture
    write_file(folder / "trajectory.tum", tum_text(result.stamps, result.trajectory))
    write_file(folder / "local_trajectory.tum", tum_text(result.stamps, result.local_trajectory))
    write_file(folder / "graph.g2o", g2o_text(result.graph))
    write_file(folder / "nodes.csv", nodes_csv(result))
    write_file(folder / "closures.csv", closures_csv(result))
    write_file(folder / map_file.FILE_NAME, map_bytes(result))
    toml = config_toml(result.config, origins, without=MACHINE_PARAMETERS)
    left_out = f"Without {', '.join(sorted(MACHINE_PARAMETERS))}: the result does not depend on it."
    write_file(folder / "config.toml", f"{toml}\n# {left_out}\n")
    save_report(replace(result.report, config_hash=config_hash(result.config)), folder)


def save_report(report: Report, out: str | PathLike[str]) -> None:
    """Write ``report.json`` into the folder `out`, replacing an existing one."""
    write_file(Path(out) / "report.json", report.to_json())


def prepare_folder(out: str | PathLike[str]) -> Path:
    """Create the folder `out` if necessary, and check that it is writable.

    Raises
    ------
    OutputError
        It is not.
    """
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".cartoloop-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot write there: {error.strerror}; choose another output folder"
        ) from error
    return folder


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


def png_bytes(result: MapData, picture: MapPicture, layers: Collection[Layer]) -> bytes:
    """Return the picture of a map as a PNG file, with layers drawn over it."""
    picture.draw(
        trajectory=result.trajectory if "trajectory" in layers else None,
        closures=_closure_ends(result.graph) if "closures" in layers else None,
        places=result.report.quality.places if "quality" in layers else (),
    )
    buffer = io.BytesIO()
    picture.canvas.save(buffer, format="png")
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
