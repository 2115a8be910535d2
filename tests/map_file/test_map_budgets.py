# SPDX-License-Identifier: Apache-2.0
"""Maps of a few bytes that stand for millions of cells or submaps are refused at once."""

from __future__ import annotations

import json
import sqlite3
import zlib
from contextlib import closing

import pytest

from cartoloop.errors import InputError
from cartoloop.map_output.output_folder import SavedMap, saved_map
from cartoloop.map_output.save import save
from cartoloop.result import load_map
from tests.map_output.small_result import small_result

NOTHING = zlib.compress(b"")


def _submaps(count, rows, cols, cells):
    def change(database):
        values = ((i, rows, cols, cells) for i in range(1, count + 1))
        database.executemany("INSERT INTO submaps VALUES (?,0,0,0,?,?,0,0,0.05,?)", values)

    return change


def _endless(database):
    database.execute("DROP TABLE trajectory")
    database.execute(
        "CREATE VIEW trajectory AS WITH RECURSIVE s(n) AS (SELECT 0 UNION ALL SELECT n+1 FROM s) "
        "SELECT n, n, 0, 0, 0, 0, 0, 0 FROM s"
    )


def _nested(database):
    database.execute("UPDATE about SET value = ? WHERE key = 'report'", ("[" * 100_000,))


def _scans_of_text(database):
    [report] = database.execute("SELECT value FROM about WHERE key = 'report'").fetchone()
    report = json.loads(report)
    report["input"]["scans"] = "many"
    database.execute("UPDATE about SET value = ? WHERE key = 'report'", (json.dumps(report),))


@pytest.mark.parametrize(
    ("change", "reported"),
    [
        (_submaps(5000, 0, 0, NOTHING), "submaps cannot stand in"),
        (_submaps(30, 2**10, 2**11, zlib.compress(bytes(2**21))), "cells cannot stand in"),
        (_endless, "no plain table"),
        (_nested, "is damaged"),
        (_scans_of_text, "the number of scans is 'many'"),
    ],
)
def test_a_map_that_stands_for_too_much_is_refused(tmp_path, change, reported):
    save(small_result(), tmp_path)
    path = tmp_path / "map.cartoloop"
    with closing(sqlite3.connect(path)) as database:
        change(database)
        database.commit()
    with pytest.raises(InputError, match=reported) as caught:
        load_map(path)
    assert "\n" not in str(caught.value)


def test_triggers_and_views_of_others_do_nothing(tmp_path):
    save(small_result(), tmp_path)
    path = tmp_path / "map.cartoloop"
    with closing(sqlite3.connect(path)) as database:
        database.executescript(
            "CREATE TRIGGER t AFTER INSERT ON nodes BEGIN DELETE FROM nodes; END;"
            "CREATE VIEW endless AS WITH RECURSIVE s(n) AS (SELECT 0 UNION ALL SELECT n FROM s) "
            "SELECT n FROM s;"
        )
        database.commit()
    before = path.read_bytes()

    assert load_map(path).graph.num_nodes == 2
    assert path.read_bytes() == before


def test_a_run_does_not_wait_for_a_hostile_map(tmp_path, monkeypatch):
    monkeypatch.setattr("cartoloop.foreign_database._FREE_STEPS", 200_000)
    with closing(sqlite3.connect(tmp_path / "map.cartoloop")) as database:
        database.executescript(
            "CREATE VIEW about AS WITH RECURSIVE s(n) AS (SELECT 0 UNION ALL SELECT n FROM s) "
            "SELECT 'report' AS key, n AS value FROM s;"
        )

    assert saved_map(tmp_path) == SavedMap(("map.cartoloop",))
