# SPDX-License-Identifier: Apache-2.0
"""map.pgm and map.yaml, read by the rules of ROS's map_server."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from cartoloop.config import MapOutputConfig
from cartoloop.map_output.map_files import pgm_bytes, yaml_text
from cartoloop.map_output.occupancy_map import OccupancyMap

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
CONFIG = MapOutputConfig()


def map_of(probability, origin=(0.0, 0.0), resolution=0.05):
    return OccupancyMap(np.array(probability, dtype=np.float32), *origin, resolution)


def parse_yaml(text):
    return dict(line.split(": ", 1) for line in text.splitlines())


def map_server_cells(pgm, yaml):
    """The occupancy grid that map_server makes of the files: row-major from the lower left."""
    header = parse_yaml(yaml)
    shades = np.asarray(Image.open(io.BytesIO(pgm))).astype(float)[::-1] / 255.0
    assert header["mode"] == "trinary"
    assert header["negate"] == "0"
    occupancy = 1.0 - shades
    cells = np.full(shades.shape, UNKNOWN)
    cells[occupancy < float(header["free_thresh"])] = FREE
    cells[occupancy > float(header["occupied_thresh"])] = OCCUPIED
    return cells.tolist()


def reread(occupancy_map, config=CONFIG):
    return map_server_cells(
        pgm_bytes(occupancy_map, config), yaml_text(occupancy_map, config, "map.pgm")
    )


def test_map_server_reads_free_occupied_and_unknown_cells():
    occupancy_map = map_of([[0.1, 0.9, -1.0], [0.5, 0.05, 0.66]])

    assert reread(occupancy_map) == [[FREE, OCCUPIED, UNKNOWN], [UNKNOWN, FREE, OCCUPIED]]


def test_shades_are_the_customary_ones_with_the_top_row_first():
    pgm = pgm_bytes(map_of([[0.1, 0.9], [-1.0, -1.0]]), CONFIG)

    assert pgm == b"P5\n# 0.05 m/pixel\n2 2\n255\n" + bytes([205, 205, 254, 0])


@pytest.mark.parametrize(
    "thresholds", [{"free_thresh": 0.45}, {"occupied_thresh": 0.1, "free_thresh": 0.05}]
)
def test_unknown_stays_unknown_with_any_thresholds(thresholds):
    config = CONFIG.model_copy(update=thresholds)

    assert reread(map_of([[-1.0]]), config) == [[UNKNOWN]]
    assert reread(map_of([[0.02, 0.98]]), config) == [[FREE, OCCUPIED]]


def test_thresholds_of_the_configuration_decide():
    assert reread(map_of([[0.3, 0.6]])) == [[UNKNOWN, UNKNOWN]]
    config = CONFIG.model_copy(update={"free_thresh": 0.4, "occupied_thresh": 0.55})
    assert reread(map_of([[0.3, 0.6]]), config) == [[FREE, OCCUPIED]]


def test_yaml_states_resolution_and_origin_in_full():
    text = yaml_text(map_of([[0.1]], (-123.456789, 7.05), 0.025), CONFIG, "map.pgm")

    assert parse_yaml(text) == {
        "image": "map.pgm",
        "mode": "trinary",
        "resolution": "0.025",
        "origin": "[-123.456789, 7.05, 0.0]",
        "negate": "0",
        "occupied_thresh": "0.65",
        "free_thresh": "0.196",
    }
