# SPDX-License-Identifier: Apache-2.0
"""What adjustment has to know of a graph, in its file: what is held, and what is trusted."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import numpy as np
import pytest

from cartoloop.config import Config
from cartoloop.earlier_sessions import EarlierMaps
from cartoloop.errors import InputError
from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.map_file.read import read_map
from cartoloop.map_file.write import map_bytes
from cartoloop.runtime.stage_timer import StageTimer
from tests.map_output.small_result import small_result


def written(tmp_path, result, *statements):
    path = tmp_path / "map.cartoloop"
    path.write_bytes(map_bytes(result))
    with closing(sqlite3.connect(path)) as database:
        for statement in statements:
            database.execute(statement)
        database.commit()
    return path


def test_pins_are_kept_in_the_file_and_when_mapping_goes_on(tmp_path):
    result = small_result()
    result.graph.hold_only([], [1])

    read = read_map(written(tmp_path, result))

    assert (read.graph.fixed_submaps, read.graph.fixed_nodes) == ((), (1,))
    slam = GlobalSlam(Config().global_slam, StageTimer(), mapped=EarlierMaps([read]).mapped)
    assert slam.graph.fixed_nodes == (1,)
    slam.close()


def test_without_pins_the_first_submap_is_held(tmp_path):
    read = read_map(written(tmp_path, small_result(), "DROP TABLE held", "DROP TABLE trusted"))

    assert (read.graph.fixed_submaps, read.graph.fixed_nodes) == ((0,), ())
    assert not read.graph.is_trusted.any()


def test_trusted_closures_are_read_as_they_were_written(tmp_path):
    result = small_result()
    graph = result.graph
    closures = np.flatnonzero(graph.closure_rows >= 0)
    assert len(closures) > 0
    graph.is_trusted[closures[0]] = True

    read = read_map(written(tmp_path, result)).graph

    trusted = graph.closure_rows[graph.is_trusted]
    assert read.closure_rows[read.is_trusted].tolist() == trusted.tolist()


@pytest.mark.parametrize(
    "statement",
    [
        "INSERT INTO held VALUES (0, 99, NULL)",
        "INSERT INTO held VALUES (0, NULL, -1)",
        "INSERT INTO held VALUES (0, 'x', NULL)",
        "INSERT INTO trusted VALUES (-3)",
        "WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n WHERE i < 10001) "
        "INSERT INTO held SELECT i, 0, NULL FROM n",
    ],
)
def test_damaged_tables_are_refused(tmp_path, statement):
    with pytest.raises(InputError, match="is damaged"):
        read_map(written(tmp_path, small_result(), statement))
