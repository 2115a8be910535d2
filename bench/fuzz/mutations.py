# SPDX-License-Identifier: Apache-2.0
"""Changes of inputs: of bytes, of words, of the rows of databases, of arguments."""

from __future__ import annotations

import re
import sqlite3
import struct
from collections.abc import Sequence
from contextlib import closing, suppress
from pathlib import Path
from random import Random

NUMBERS = (
    "0", "-0", "1", "-1", "nan", "inf", "-inf", "1e999", "1e308", "-1e308", "1e-320", "0x10",
    "9" * 30, "9" * 5000, "2147483648", "4294967296", "9223372036854775808", "1.5.2", "1_000",
    "81.91", "-1.0", "1e9", "3.14159265", "null", "true", "[]", "{}", '""', "",
)  # fmt: skip
"""Words in place of numbers."""

WORDS = (
    b"FLASER", b"ODOM", b"PARAM", b"ROBOTLASER1", b"RAWLASER1", b"Laser", b"Odometry", b"ranges",
    b"time", b"angle_min", b"\n", b"\r\n", b"\x00", b"\xff\xfe", b"\x1b[2J", b",", b"#", b"=", b"[",
    b"{", b'"', b"'", b"[[", b"<", b"</", b"&#10;", b"<!DOCTYPE", b"scan", b"cloud", b"end", b"imu",
    b"type", b"NaN", b"Infinity", b"\xed\xa0\x80", b"\xe2\x80\xae", b"%s", b"../", b"A" * 300,
)  # fmt: skip
"""Pieces that mean something to one of the readers."""

VALUES = (
    None, 0, 1, -1, 2**31, 2**53, 2**63 - 1, -(2**63), 1e308, -1e308, 1e-300, float("inf"),
    "", "text", "\x1b[2J\n", b"", b"\x00" * 64, "{}", "[]", "null", 0.5, 1e9, 3,
)  # fmt: skip
"""Values of the columns of a database."""

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def mutated(random: Random, data: bytes, other: bytes = b"") -> bytes:
    """Return a changed copy: some bytes, words or numbers are replaced, moved or lost.

    Parameters
    ----------
    other : another input of the same kind; parts of it are taken over.
    """
    changed = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 3, 8))):
        random.choice(_CHANGES)(random, changed, other)
    return bytes(changed)


def _place(random: Random, data: bytearray) -> int:
    return random.randrange(len(data) + 1)


def _flip(random: Random, data: bytearray, _: bytes) -> None:
    for _bit in range(random.choice((1, 1, 4, 32))):
        if data:
            data[random.randrange(len(data))] ^= 1 << random.randrange(8)


def _set_integer(random: Random, data: bytearray, _: bytes) -> None:
    size, code = random.choice(((1, "B"), (2, "H"), (4, "I"), (8, "Q")))
    if len(data) < size:
        return
    most = (1 << 8 * size) - 1
    value = random.choice((0, 1, most, most >> 1, min(len(data), most), random.randrange(most + 1)))
    struct.pack_into(
        random.choice("<>") + code, data, random.randrange(len(data) - size + 1), value
    )


def _cut(random: Random, data: bytearray, _: bytes) -> None:
    start = _place(random, data)
    del data[start : start + random.choice((1, 4, 100, len(data)))]


def _repeat(random: Random, data: bytearray, _: bytes) -> None:
    start = _place(random, data)
    piece = bytes(data[start : start + random.choice((1, 8, 200))])
    data[start:start] = piece * random.choice((1, 2, 50))


def _insert(random: Random, data: bytearray, _: bytes) -> None:
    start = _place(random, data)
    data[start:start] = random.choice(WORDS) if random.random() < 0.7 else random.randbytes(8)


def _replace_number(random: Random, data: bytearray, _: bytes) -> None:
    start = _place(random, data)
    found = _NUMBER.search(data, start) or _NUMBER.search(data)
    if found is not None:
        data[found.start() : found.end()] = random.choice(NUMBERS).encode()


def _splice(random: Random, data: bytearray, other: bytes) -> None:
    start, begin = _place(random, data), random.randrange(len(other) + 1)
    data[start : start + random.choice((0, 50, 2000))] = other[begin : begin + 2000]


def _swap_lines(random: Random, data: bytearray, _: bytes) -> None:
    lines = bytes(data).split(b"\n")
    one, two = random.randrange(len(lines)), random.randrange(len(lines))
    lines[one], lines[two] = lines[two], lines[one]
    data[:] = b"\n".join(lines)


_CHANGES = (
    _flip, _set_integer, _cut, _repeat, _insert, _insert, _replace_number, _replace_number,
    _replace_number, _splice, _swap_lines,
)  # fmt: skip


def mutate_database(random: Random, path: Path) -> None:
    """Change values, rows or tables of a database; its pages stay sound."""
    with closing(sqlite3.connect(path)) as database, suppress(sqlite3.Error):
        query = "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite%'"
        tables = [row[0] for row in database.execute(query)]
        for _ in range(random.choice((1, 1, 2, 5))):
            with suppress(sqlite3.Error):
                _change_table(random, database, random.choice(tables))
        database.commit()


def _change_table(random: Random, database: sqlite3.Connection, table: str) -> None:
    columns = [row[1] for row in database.execute(f"PRAGMA table_info({table})")]
    if not columns:
        return  # dropped
    column = random.choice(columns)
    rows = "rowid IN (SELECT rowid FROM %s ORDER BY rowid LIMIT 1 OFFSET %d)"
    where = rows % (table, random.randrange(20)) if random.random() < 0.8 else "1"
    if table == "about":
        where = f"key = '{random.choice(('name', 'config', 'report', 'program'))}'"
    kind = random.random()
    if kind < 0.05:
        database.execute(f"DROP TABLE {table}")
    elif kind < 0.15:
        database.execute(f"DELETE FROM {table} WHERE {where}")
    elif kind < 0.2:
        database.execute(f"ALTER TABLE {table} DROP COLUMN {column}")
    elif kind < 0.5 and (row := database.execute(
        f"SELECT {column} FROM {table} WHERE {where}"
    ).fetchone()) and isinstance(row[0], str | bytes):  # fmt: skip
        raw = row[0].encode() if isinstance(row[0], str) else row[0]
        changed = mutated(random, raw)
        shown = changed.decode("utf-8", "replace") if isinstance(row[0], str) else changed
        database.execute(f"UPDATE {table} SET {column} = ? WHERE {where}", (shown,))
    else:
        value = random.choice(VALUES)
        database.execute(f"UPDATE {table} SET {column} = ? WHERE {where}", (value,))


def mutate_arguments(random: Random, arguments: Sequence[str], options: Sequence[str]) -> list[str]:
    """Return a changed command line; paths in it stay below the present folder.

    Parameters
    ----------
    options : that may be inserted.
    """
    changed = list(arguments)
    for _ in range(random.choice((1, 1, 2, 4))):
        place = random.randrange(1, len(changed) + 1)
        match random.randrange(5):
            case 0 if place < len(changed):
                del changed[place]
            case 1:
                changed.insert(place, random.choice(options))
            case 2 if place < len(changed):
                changed[place] = random.choice(NUMBERS)
            case 3 if place < len(changed):
                raw = mutated(random, changed[place].encode("utf-8", "surrogateescape"))
                changed[place] = raw.decode("utf-8", "replace")
            case _:
                changed.insert(place, random.choice(NUMBERS))
    return [_harmless(argument) for argument in changed]


def _harmless(argument: str) -> str:
    return argument.replace("\x00", "").replace("/", "_").replace("..", "_")
