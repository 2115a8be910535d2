# SPDX-License-Identifier: Apache-2.0
"""Name and picture of a map before all of it is read; none of what is no map."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing

import pytest

from cartoloop.map_file.first_look import first_look


@pytest.fixture
def folder(ring_result, shared_files, tmp_path):
    """A saved map that a test may damage."""
    saved = shared_files.path("ring_saved", ring_result.save)
    for name in ("map.cartoloop", "map.png", "report.json"):
        shutil.copy(saved / name, tmp_path)
    return tmp_path


def change(folder, statement, *values):
    with closing(sqlite3.connect(folder / "map.cartoloop")) as database:
        database.execute(statement, values)
        database.commit()


def test_first_look_has_name_and_picture(folder, ring_result):
    look = first_look(folder)

    assert look.name == ring_result.report.input.name
    assert look.picture == (folder / "map.png").read_bytes()


def test_control_characters_of_the_name_are_visible(folder):
    change(folder, "UPDATE about SET value = ? WHERE key = 'report'",
           '{"input": {"name": "a\\u001b[2Jb"}}')  # fmt: skip
    assert first_look(folder).name == "a\\x1b[2Jb"


@pytest.mark.parametrize("name", ["map.cartoloop", "map.png"])
def test_there_is_no_first_look_without_a_file(folder, name):
    (folder / name).unlink()
    assert first_look(folder) is None
    (folder / name).write_bytes(b"")
    assert first_look(folder) is None
    (folder / name).write_bytes(b"no map" * 1000)
    assert first_look(folder) is None
    (folder / name).unlink()
    (folder / name).mkdir()
    assert first_look(folder) is None


@pytest.mark.parametrize(
    "statement",
    [
        "PRAGMA application_id = 1",
        "PRAGMA user_version = 99",
        "DELETE FROM about",
        "UPDATE about SET value = '[]' WHERE key = 'report'",
        "UPDATE about SET value = '{' WHERE key = 'report'",
        "UPDATE about SET value = zeroblob(9) WHERE key = 'report'",
        "UPDATE about SET value = '{\"input\": 1}' WHERE key = 'report'",
        "DROP TABLE about",
        "ALTER TABLE about RENAME TO other",
    ],
)
def test_what_is_no_map_has_no_first_look(folder, statement):
    assert first_look(folder) is not None
    change(folder, statement)
    assert first_look(folder) is None


def test_a_deep_report_has_no_first_look(folder):
    report = "[" * 200_000
    change(folder, "UPDATE about SET value = ? WHERE key = 'report'", report)
    assert first_look(folder) is None


def test_a_view_in_place_of_a_table_has_no_first_look(folder):
    change(folder, "ALTER TABLE about RENAME TO other")
    change(folder, "CREATE VIEW about AS SELECT * FROM other")
    assert first_look(folder) is None
