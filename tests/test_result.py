# SPDX-License-Identifier: Apache-2.0
"""What a result offers besides its files."""

from __future__ import annotations

import numpy as np

import cartoloop
from cartoloop.map_output.occupancy_map import compose_map
from tests.map_output.small_result import small_result


def test_the_map_is_that_of_the_export_and_composed_once():
    result = small_result()
    exported = compose_map(
        result.submap_grids, result.graph.submap_poses, result.config.local_slam.submaps
    )

    assert np.array_equal(result.occupancy_map().probability, exported.probability)
    assert result.occupancy_map() is result.occupancy_map()


def test_a_result_is_shown_in_a_line():
    assert repr(small_result()) == (
        "<Result: 3 scans, 2 nodes, 1 submaps, 1 loop closures (0 pairs searched)>"
    )


def test_results_are_equal_only_to_themselves():
    result = small_result()
    assert result == result
    assert result != small_result()


def test_a_saved_map_is_loaded_by_its_folder(tmp_path):
    small_result().save(tmp_path)

    assert cartoloop.load(tmp_path).graph.num_nodes == 2


def test_public_names_are_listed_and_there():
    assert {"Mapper", "load", "load_map", "open_log", "read"} <= set(dir(cartoloop))
    assert all(getattr(cartoloop, name) is not None for name in dir(cartoloop))
