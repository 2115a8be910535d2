# SPDX-License-Identifier: Apache-2.0
"""The sessions of a map in its file."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace

import pytest

from cartoloop.errors import InputError
from cartoloop.map_file.read import read_map
from cartoloop.map_file.write import map_bytes
from cartoloop.session import Session
from tests.map_output.small_result import small_result

TWO = (
    Session("first", "a.log", "0123", stamp=100.0, calibration={"odometry": {"yaw": 0.1}}),
    Session("second", "b.log", "4567", first_scan=2, first_node=1, first_submap=1, part=1),
)


def written(tmp_path, sessions, *statements):
    path = tmp_path / "map.cartoloop"
    path.write_bytes(map_bytes(replace(small_result(), sessions=sessions)))
    with closing(sqlite3.connect(path)) as database:
        for statement in statements:
            database.execute(statement)
        database.commit()
    return path


def test_sessions_are_read_as_they_were_written(tmp_path):
    first, second = read_map(written(tmp_path, TWO)).sessions
    assert first == TWO[0]
    assert replace(second, stamp=0.0) == replace(TWO[1], stamp=0.0)


def test_scans_nodes_and_submaps_know_their_parts(tmp_path):
    content = read_map(written(tmp_path, TWO))
    assert content.scan_parts.tolist() == [0, 0, 1]
    assert content.node_parts.tolist() == [0, 1]
    assert content.submap_parts.tolist() == [0]


def test_map_of_an_older_version_is_one_session(tmp_path):
    path = written(tmp_path, TWO, "DROP TABLE sessions", "PRAGMA user_version = 4")
    (session,) = read_map(path).sessions
    assert session.first_scan == session.part == 0
    assert session.stamp == 100.0


@pytest.mark.parametrize(
    "damage",
    [
        "DELETE FROM sessions",
        "DELETE FROM sessions WHERE session = 0",
        "UPDATE sessions SET first_scan = 9 WHERE session = 1",
        "UPDATE sessions SET first_node = -1",
        "UPDATE sessions SET first_submap = 'x'",
        "UPDATE sessions SET part = 1e300",
        "UPDATE sessions SET calibration = '[1]'",
        "UPDATE sessions SET calibration = '{'",
        "UPDATE sessions SET name = NULL",
        "UPDATE sessions SET stamp = 9e999",
    ],
)
def test_damaged_table_of_sessions_is_refused(tmp_path, damage):
    with pytest.raises(InputError, match="is damaged"):
        read_map(written(tmp_path, TWO, damage))
