# SPDX-License-Identifier: Apache-2.0
"""Whether the files of a map can be opened, each by what would read it, and what they are."""

from __future__ import annotations

import csv
import hashlib
import json
import tomllib
from collections.abc import Callable
from pathlib import Path

from PIL import Image

from bench.g2o import read_g2o
from cartoloop.evaluation.trajectories import read_tum
from cartoloop.map_file.file_set import FILES
from cartoloop.map_output.output_folder import saved_map
from cartoloop.result import load_map


def opening_fault(path: Path) -> str:
    """Return why a file of a map cannot be opened, or "".

    Raises
    ------
    KeyError
        It is no file of a map.
    """
    open_it = _OPEN[path.name]
    try:
        open_it(path)
    except Exception as error:  # noqa: BLE001 - whatever it is, the file does not open
        return f"{path.name} does not open: {type(error).__name__}: {error}"
    return ""


def _open_image(path: Path) -> None:
    with Image.open(path) as image:
        image.load()


def _open_table(path: Path) -> None:
    with path.open(encoding="utf-8", newline="") as file:
        lengths = {len(row) for row in csv.reader(file) if row and not row[0].startswith("#")}
    if len(lengths) != 1:
        raise ValueError(f"its rows have {lengths} fields")


def _open_yaml(path: Path) -> None:
    keys = dict(line.split(": ", 1) for line in path.read_text(encoding="utf-8").splitlines())
    thresholds = float(keys["free_thresh"]), float(keys["occupied_thresh"])
    if not thresholds[0] < thresholds[1]:
        raise ValueError(f"its thresholds are {thresholds}")
    if not (path.parent / keys["image"]).exists():
        raise ValueError(f"{keys['image']} is not there")


_OPEN: dict[str, Callable[[Path], object]] = {
    "map.pgm": _open_image,
    "map.png": _open_image,
    "map.yaml": _open_yaml,
    "trajectory.tum": read_tum,
    "local_trajectory.tum": read_tum,
    "graph.g2o": read_g2o,
    "nodes.csv": _open_table,
    "closures.csv": _open_table,
    "map.cartoloop": load_map,
    "config.toml": lambda path: tomllib.loads(path.read_text(encoding="utf-8")),
    "report.json": lambda path: json.loads(path.read_bytes()),
}


def digests_of(folder: Path) -> dict[str, str]:
    """Return what identifies each file of a map, by its name."""
    return {name: digest_of(folder / name) for name in FILES}


def digest_of(path: Path) -> str:
    """Return what identifies a file: of the report, which has times in it, the configuration."""
    if path.name == "report.json":
        saved = saved_map(path.parent)
        return "" if saved is None else f"{saved.name} {_config_of(path)}"
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _config_of(report: Path) -> str:
    return str(json.loads(report.read_text(encoding="utf-8"))["config_hash"])
