# SPDX-License-Identifier: Apache-2.0
"""Databases of others are only read, and their queries end."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import pytest

from cartoloop import foreign_database
from cartoloop.foreign_database import open_database


def _database(path, *statements):
    with closing(sqlite3.connect(path)) as database:
        for statement in statements:
            database.execute(statement)
        database.commit()
    return path


@pytest.mark.parametrize(
    "statement",
    [
        "CREATE VIEW t AS SELECT 1 AS a",
        "CREATE TABLE t (a, b GENERATED ALWAYS AS (zeroblob(1000000000)))",
        "CREATE TABLE t (a, b AS (a || a))",
    ],
)
def test_computed_tables_are_refused(tmp_path, statement):
    path = _database(tmp_path / "a?b#c.db", statement)
    with pytest.raises(sqlite3.DatabaseError, match="t is no plain table"):
        open_database(path, ["t"])


def test_definitions_that_are_no_text_are_refused(tmp_path):
    path = _database(tmp_path / "a.db", "CREATE TABLE t (a, bbbb)")
    path.write_bytes(path.read_bytes().replace(b"bbbb", b"bb\xc2b"))
    with pytest.raises(sqlite3.DatabaseError):
        open_database(path, ["t"])


def test_plain_tables_are_read_and_not_written(tmp_path):
    path = _database(tmp_path / "a?b#c.db", "CREATE TABLE t (a)", "INSERT INTO t VALUES (1)")
    with closing(open_database(path, ["t", "none"])) as database:
        assert database.execute("SELECT a FROM t").fetchall() == [(1,)]
        with pytest.raises(sqlite3.OperationalError, match="readonly"):
            database.execute("DELETE FROM t")
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_a_query_without_end_is_interrupted(tmp_path, monkeypatch):
    monkeypatch.setattr(foreign_database, "_FREE_STEPS", 200_000)
    path = _database(tmp_path / "a.db", "CREATE TABLE t (a)")
    endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n) SELECT count(*) FROM n"
    with (
        closing(open_database(path, ["t"])) as database,
        pytest.raises(sqlite3.OperationalError, match="interrupted"),
    ):
        database.execute(endless).fetchall()
