# SPDX-License-Identifier: Apache-2.0
"""Reading a saved map back: an image, and the YAML file of ROS's map_server that goes with it."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from cartoloop.arrays import FloatArray
from cartoloop.errors import InputError
from cartoloop.evaluation.text_table import read_text_lines
from cartoloop.sensor.pose import Pose, inverse, transform_points

UNKNOWN = np.float32(-1.0)
"""Stands for the occupancy of pixels that are declared to hold no value."""

_KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
_MAX_PIXELS = 2**27
"""Of a map: a square of 580 m in cells of 5 cm."""

_MIN_RESOLUTION_M, _MAX_RESOLUTION_M = 1e-3, 10.0
_MODES = ("trinary", "scale", "raw")
_FALSE, _TRUE = ("0", "false", "no", "off"), ("1", "true", "yes", "on")


@dataclass(frozen=True)
class MapImage:
    """A map as its image shows it.

    Attributes
    ----------
    occupancy : float32, shape (rows, cols), in [0, 1], -1 where the image declares no value; row =
        y, col = x in the image's own axes, so that row 0 is the bottom of the image.
    resolution : pixel edge [m].
    origin : pose of the lower-left corner of the image in the map frame.
    occupied_thresh, free_thresh : pixels above the one are occupied, below the other free, and
        neither in between.
    """

    occupancy: NDArray[np.float32]
    resolution: float
    origin: Pose
    occupied_thresh: float
    free_thresh: float

    def to_pixels(self, points_map: FloatArray) -> FloatArray:
        """Return points (n, 2) [m, map frame] as (column, row); pixel (i, j) spans i..i+1, j..j+1.

        Rows count from the bottom, like those of `occupancy`.
        """
        return transform_points(inverse(self.origin), points_map) / self.resolution

    def holds(self, points_map: FloatArray) -> NDArray[np.bool_]:
        """Return which of the points (n, 2) [m, map frame] lie within the image."""
        rows, cols = self.occupancy.shape
        pixels = self.to_pixels(points_map)
        inside: NDArray[np.bool_] = np.all((pixels >= 0.0) & (pixels <= (cols, rows)), axis=1)
        return inside

    def sample(self, points_map: FloatArray) -> NDArray[np.float32]:
        """Return the occupancy of the pixel each point (n, 2) [m, map frame] lies in, shape (n,).

        Pixels outside the image are unknown: -1.
        """
        rows, cols = self.occupancy.shape
        col, row = np.floor(self.to_pixels(points_map)).astype(np.int64).T
        inside = (col >= 0) & (col < cols) & (row >= 0) & (row < rows)
        occupancy = np.full(len(points_map), UNKNOWN)
        occupancy[inside] = self.occupancy[row[inside], col[inside]]
        return occupancy


def read_map(path: str | PathLike[str]) -> MapImage:
    """Return the map of a ``map.yaml``, or of the folder that holds one.

    Parameters
    ----------
    path : the YAML file, as ROS's map_server reads it, or a folder with ``map.yaml`` in it.

    Raises
    ------
    InputError
        The YAML file or the image cannot be read, a key is missing or its value impossible.

    Notes
    -----
    Of a pixel, ``trinary`` and ``scale`` take the mean of its channels as shade, dark for occupied
    unless `negate`; in ``scale`` mode pixels that are not opaque are unknown. In ``raw`` mode the
    value is the occupancy in percent, and above 100 unknown.
    """
    path = Path(path)
    if path.is_dir():
        if not (path / "map.yaml").is_file():
            raise InputError(f"{path}: holds no map.yaml; give the YAML file of a map")
        path = path / "map.yaml"
    values = _read_yaml(path)
    if missing := [key for key in _KEYS if key not in values]:
        raise InputError(
            f"{path}: lacks {', '.join(missing)}; a map_server YAML file has {', '.join(_KEYS)}"
        )
    mode = str(values.get("mode", "trinary")).lower()
    if mode not in _MODES:
        raise InputError(f"{path}: mode is '{mode}'; expected {', '.join(_MODES)}")
    resolution = _number(path, values, "resolution")
    if not _MIN_RESOLUTION_M <= resolution <= _MAX_RESOLUTION_M:
        raise InputError(
            f"{path}: resolution is {resolution:g}; expected metres a pixel, "
            f"{_MIN_RESOLUTION_M:g} to {_MAX_RESOLUTION_M:g}"
        )
    image = values["image"]
    if not isinstance(image, str) or not image:
        raise InputError(f"{path}: image is '{image}'; expected the name of an image file")
    occupied, free = (_number(path, values, f"{name}_thresh") for name in ("occupied", "free"))
    if not 0.0 <= free <= occupied <= 1.0:
        raise InputError(
            f"{path}: free_thresh is {free:g}, occupied_thresh {occupied:g}; expected 0 to 1, and "
            "the first not above the second"
        )
    return MapImage(
        occupancy=_read_occupancy(path.parent / image, mode, _negate(path, values), path),
        resolution=resolution,
        origin=_origin(path, values),
        occupied_thresh=occupied,
        free_thresh=free,
    )


def _read_yaml(path: Path) -> dict[str, str | list[str]]:
    """Return the values of a flat YAML file as text, lists as lists of text.

    Maps are described by scalars and one list of three numbers, in brackets or one a line.
    """
    lines = read_text_lines(path, "the YAML file of a map")
    values: dict[str, str | list[str]] = {}
    key = ""
    for number, line in enumerate(lines, start=1):
        text = re.sub(r"(^|\s)#.*", "", line).strip()
        if not text or text in ("---", "...") or text.startswith("%"):
            continue
        if (item := re.fullmatch(r"-\s+(.+)", text)) and key and not values[key]:
            values[key] = [_unquoted(item[1])]
        elif item and key and isinstance(entries := values[key], list):
            entries.append(_unquoted(item[1]))
        elif pair := re.fullmatch(r"(\w+)\s*:(?:\s+(.*))?", text):
            key, value = pair[1], pair[2] or ""
            if value.startswith("[") and value.endswith("]"):
                values[key] = [_unquoted(entry.strip()) for entry in value[1:-1].split(",")]
            else:
                values[key] = _unquoted(value)
        else:
            raise InputError(f"{path}:{number}: expected 'key: value', found '{text[:60]}'")
    return values


def _unquoted(text: str) -> str:
    if len(text) >= 2 and text[0] == text[-1] and text[0] in "'\"":
        return text[1:-1]
    return text


def _number(path: Path, values: dict[str, str | list[str]], key: str) -> float:
    return _to_number(path, key, values[key])


def _to_number(path: Path, key: str, value: str | list[str]) -> float:
    try:
        number = float(value) if isinstance(value, str) else math.nan
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{path}: {key} is '{value}'; expected a number")
    return number


def _negate(path: Path, values: dict[str, str | list[str]]) -> bool:
    value = str(values["negate"]).lower()
    if value not in _FALSE + _TRUE:
        raise InputError(f"{path}: negate is '{value}'; expected 0 or 1")
    return value in _TRUE


def _origin(path: Path, values: dict[str, str | list[str]]) -> Pose:
    origin = values["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        given = f"[{', '.join(origin)}]" if isinstance(origin, list) else origin
        raise InputError(f"{path}: origin is '{given}'; expected [x, y, yaw]")
    return Pose(*(_to_number(path, "origin", value) for value in origin))


def _read_occupancy(image: Path, mode: str, negate: bool, named_by: Path) -> NDArray[np.float32]:
    """Return the occupancy of an image's pixels, row 0 at the bottom."""
    try:
        if not image.is_file():
            raise InputError(f"{image}: no such image; {named_by} names it")
        shade, opaque = _read_shades(image, with_alpha=mode == "trinary")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{image}: cannot be read as an image: {reason}") from error
    if mode == "raw":
        value = np.rint(shade * 255.0)
        occupancy = np.where(value <= 100.0, value / 100.0, UNKNOWN)
    else:
        occupancy = shade if negate else 1.0 - shade
        if mode == "scale":
            occupancy = np.where(opaque, occupancy, UNKNOWN)
    return np.ascontiguousarray(occupancy[::-1], dtype=np.float32)


def _read_shades(image: Path, *, with_alpha: bool) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the mean of each pixel's channels in [0, 1], and which pixels are opaque.

    Parameters
    ----------
    image : the file; its row 0 is row 0 here.
    with_alpha : whether transparency is one of the channels, as map_server has it if trinary.
    """
    with warnings.catch_warnings():
        # Large floors are meant to be large.
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        with Image.open(image) as opened:
            if opened.width * opened.height > _MAX_PIXELS:
                raise ValueError(f"{opened.width} by {opened.height} pixels are no map")
            opened.load()
            if opened.mode.startswith("I"):  # 16 bits
                shade = np.asarray(opened, dtype=np.float32) / np.float32(65535.0)
                return shade, np.ones(shade.shape, dtype=np.bool_)
            if opened.mode in ("1", "L"):
                shade = np.asarray(opened.convert("L"), dtype=np.float32) / np.float32(255.0)
                return shade, np.ones(shade.shape, dtype=np.bool_)
            has_alpha = "A" in opened.getbands() or "transparency" in opened.info
            channels = np.asarray(opened.convert("RGBA" if has_alpha else "RGB"), dtype=np.float32)
    opaque = channels[..., 3] == 255.0 if has_alpha else np.ones(channels.shape[:2], np.bool_)
    counted = channels if with_alpha else channels[..., :3]
    return counted.mean(axis=2) / np.float32(255.0), opaque
