# SPDX-License-Identifier: Apache-2.0
"""Rows of edits that no editor wrote are refused in a line, and cost no more than a little."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing

import pytest

from cartoloop.errors import InputError
from cartoloop.map_file.edit_table import MAX_EDITS
from cartoloop.map_file.write import map_bytes
from cartoloop.result import load_map
from tests.map_editing.edited_map import finished_map

PIN = {"submap": None, "node": 0, "pose": [0.0, 0.0, 0.0]}
ADD = {
    "submap": 0,
    "node": 3,
    "tf_submap_node": [0.0, 0.0, 0.0],
    "information": [1.0, 0.0, 0.0, 1.0, 0.0, 1.0],
    "score": 0.5,
    "residual": 0.1,
    "moved": [0.0, 0.0],
}
TIME = {"from_stamp": 100.0, "to_stamp": 101.0}
POINT = {"node": 0, "place": [0.0, 0.0], "surveyed": [0.0, 0.0]}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "map.cartoloop").write_bytes(map_bytes(finished_map()))
    return tmp_path


def insert(folder, *rows):
    with closing(sqlite3.connect(folder / "map.cartoloop")) as database, database:
        database.executemany("INSERT INTO edits VALUES (?, ?, ?, ?)", rows)


def test_sound_rows_are_applied(folder):
    rows = [("pin", PIN), ("add", ADD), ("drop", {"pairs": [[0, 5]]})]
    insert(folder, *((i, kind, json.dumps(given), 0) for i, (kind, given) in enumerate(rows)))

    loaded = load_map(folder)

    assert len(loaded.report.extra["edits"]) == 3
    assert loaded.graph.num_loop_closures == loaded.original.graph.num_loop_closures
    assert loaded.graph.fixed_nodes == (0,)


@pytest.mark.parametrize(
    ("kind", "arguments", "says"),
    [
        ("explode", {}, "'explode' is no kind of edit"),
        ("drop", {}, "pairs: Field required"),
        ("drop", {"pairs": []}, "at least 1 item"),
        ("drop", {"pairs": [[0, 6]]}, "no submap 0 or node 6"),
        ("drop", {"pairs": [[3, 0]]}, "no submap 3 or node 0"),
        ("drop", {"pairs": [[-1, 0]]}, "greater than or equal to 0"),
        ("drop", {"pairs": [[0, 1]] * 20_000}, "at most 10000 items"),
        ("drop", {"pairs": [[0, 5]], "more": 1}, "Extra inputs"),
        ("add", ADD | {"information": [-1.0, 0.0, 0.0, 1.0, 0.0, 1.0]}, "negative diagonal"),
        ("add", ADD | {"tf_submap_node": [1e300, 0.0, 0.0]}, "less than or equal"),
        ("add", ADD | {"score": "high"}, "valid number"),
        ("pin", PIN | {"node": None}, "either a submap or a node"),
        ("pin", PIN | {"submap": 0}, "either a submap or a node"),
        ("control_points", {"points": [POINT]}, "at least 2 items"),
        ("control_points", {"points": [POINT, POINT]}, "lie within 0.1 m"),
        ("align", {"angle": 1e9}, "less than or equal to 7"),
        ("forget_time", TIME | {"scans": [0, 7]}, "no scans 0 to 7"),
        ("forget_time", TIME | {"scans": [3, 3]}, "no scans 3 to 3"),
        ("forget_time", TIME | {"scans": [-1, 3]}, "greater than or equal to 0"),
        ("forget_area", {"corner": [0, 0, 0], "size": [0, 1]}, "greater than 0"),
        ("split", {"scan": 6, "name": "a"}, "no scan 6"),
        ("rename", {"scan": 0, "name": "a\u001b[2J"}, "control characters"),
        ("rename", {"scan": 0, "name": "a" * 201}, "at most 200 characters"),
    ],
)
def test_damaged_arguments_are_refused(folder, kind, arguments, says):
    insert(folder, (0, kind, json.dumps(arguments), 0))

    with pytest.raises(InputError, match=says) as error:
        load_map(folder)
    assert "is damaged" in str(error.value)
    assert "\n" not in str(error.value)


def test_rows_that_are_undone_are_checked_too(folder):
    insert(folder, (0, "drop", '{"pairs": [[0, 99]]}', 1))

    with pytest.raises(InputError, match="node 99"):
        load_map(folder)


@pytest.mark.parametrize(
    "rows",
    [
        [(1, "align", '{"angle": 0}', 0)],
        [(0, "align", '{"angle": NaN}', 0)],
        [(0, "align", "[" * 50_000, 0)],
        [(0, "align", "[]", 0)],
        [(0, "align", b"{}", 0)],
        [(0, 5.0, "{}", 0)],
        [(0, "align", '{"angle": 0}', 2)],
        [(0, "align", " " * (2 << 20) + '{"angle": 0}', 0)],
        [(i, "align", '{"angle": 0}', 0) for i in range(MAX_EDITS + 1)],
    ],
)
def test_damaged_rows_are_refused(folder, rows):
    insert(folder, *rows)

    with pytest.raises(InputError, match="is damaged"):
        load_map(folder)


def test_edits_that_are_computed_are_refused(folder):
    with closing(sqlite3.connect(folder / "map.cartoloop")) as database, database:
        database.execute("DROP TABLE edits")
        database.execute(
            "CREATE VIEW edits AS WITH RECURSIVE s(n) AS (SELECT 0 UNION ALL SELECT n+1 FROM s) "
            "SELECT n AS edit, 'align' AS kind, '{}' AS arguments, 0 AS is_undone FROM s"
        )

    with pytest.raises(InputError, match="no plain table"):
        load_map(folder)


def test_a_damaged_verdict_is_refused(folder):
    with closing(sqlite3.connect(folder / "map.cartoloop")) as database, database:
        database.execute("INSERT INTO about VALUES ('edited_quality', '[1]')")

    with pytest.raises(InputError, match="is damaged"):
        load_map(folder)


def test_the_map_as_mapped_can_be_loaded(folder):
    insert(folder, (0, "pin", json.dumps(PIN | {"pose": [5.0, 0.0, 0.0]}), 0))

    assert load_map(folder).graph.node_poses[0, 0] == pytest.approx(5.0)
    assert load_map(folder, edits=False).graph.node_poses[0, 0] == 0.0
