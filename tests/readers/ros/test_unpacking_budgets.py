# SPDX-License-Identifier: Apache-2.0
"""Chunks and files of a few bytes that stand for gigabytes end in one line."""

from __future__ import annotations

import bz2
import sqlite3
import struct
from contextlib import closing

import lz4.frame
import pytest
from rosbags.rosbag1 import reader as ros1
from rosbags.rosbag2 import reader as ros2
from rosbags.rosbag2 import storage_mcap

from cartoloop.errors import InputError
from cartoloop.readers import open_log
from cartoloop.readers.ros import unpacking
from cartoloop.readers.ros.unpacking import (
    Budget,
    BudgetError,
    limit_library,
    spending,
    unpack,
    unpack_sound_part,
)
from cartoloop.readers.ros.zstd import zstd

PACK = {"bz2": bz2.compress, "lz4": lz4.frame.compress, "zstd": zstd.compress}
ZEROS = bytes(1 << 20)


@pytest.fixture
def small_budget(monkeypatch):
    monkeypatch.setattr(unpacking, "MAX_CHUNK_BYTES", 1 << 19)
    monkeypatch.setattr(unpacking, "_FREE_BYTES", 1 << 20)
    monkeypatch.setattr(unpacking, "_RATIO", 0)


@pytest.mark.parametrize("name", PACK)
def test_chunks_are_unpacked_whole(name):
    content = bytes(range(256)) * 5000
    assert unpack(name, PACK[name](content)) == content
    assert unpack_sound_part(name, PACK[name](content)) == (content, "")
    cut, damage = unpack_sound_part(name, PACK[name](content)[:-8])
    assert content.startswith(cut)
    assert damage == "a chunk is damaged"


@pytest.mark.parametrize("name", PACK)
def test_a_chunk_beyond_its_budget_is_refused(name, small_budget):
    with pytest.raises(BudgetError, match="a chunk unpacks to more than"):
        unpack(name, PACK[name](ZEROS))
    assert unpack_sound_part(name, PACK[name](ZEROS))[0] == b""


def test_the_chunks_of_a_file_have_a_budget_together(small_budget):
    budget, packed = Budget(0), zstd.compress(ZEROS[: 1 << 18])
    with spending(budget):
        for _ in range(4):
            unpack("zstd", packed)
        with pytest.raises(BudgetError, match="it unpacks to more than"):
            unpack("zstd", packed)
    assert len(unpack("zstd", packed)) == 1 << 18


def test_the_library_unpacks_within_the_budget(small_budget):
    limit_library()
    for table in (ros1.decompressors, storage_mcap.DECOMPRESSORS):
        for name in PACK.keys() & table.keys():
            with pytest.raises(BudgetError):
                table[name](PACK[name](ZEROS), len(ZEROS))
    with pytest.raises(BudgetError):
        ros2.zstd.decompress(zstd.compress(ZEROS))
    assert ros2.zstd.decompress(zstd.compress(b"abc")) == b"abc"


def _text(content):
    return struct.pack("<I", len(content)) + content


def _mcap(name):
    packed = PACK[name](ZEROS)
    chunk = struct.pack("<QQQI", 0, 1, len(ZEROS), 0) + _text(name.encode())
    chunk += struct.pack("<Q", len(packed)) + packed
    header = _text(b"ros2") + _text(b"")
    footer = struct.pack("<QQI", 0, 0, 0)
    records = ((1, header), (6, chunk), (2, footer))
    magic = b"\x89MCAP0\r\n"
    return (
        magic + b"".join(bytes([op]) + struct.pack("<Q", len(r)) + r for op, r in records) + magic
    )


def _bag(name):
    packed = PACK[name](ZEROS)
    fields = (b"op=\x05", b"compression=" + name.encode(), b"size=" + struct.pack("<I", len(ZEROS)))
    return b"#ROSBAG V2.0\n" + _text(b"".join(map(_text, fields))) + _text(packed)


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("a.mcap", _mcap("zstd")),
        ("a.mcap", _mcap("lz4")),
        ("a.bag", _bag("bz2")),
        ("a.bag", _bag("lz4")),
        ("a.mcap.zst", zstd.compress(_mcap("zstd") + ZEROS * 4)),
        ("a.db3.zst", zstd.compress(b"SQLite format 3\x00" + ZEROS * 4)),
    ],
)
def test_a_recording_beyond_its_budget_is_refused(tmp_path, small_budget, file, content):
    (tmp_path / file).write_bytes(content)
    with pytest.raises(InputError) as caught:
        open_log(tmp_path / file)
    assert "\n" not in str(caught.value)


def test_a_database_of_endless_views_is_refused(tmp_path):
    path = tmp_path / "a.db3"
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE topics (id, name, type, serialization_format)")
        database.execute("INSERT INTO topics VALUES (1, '/scan', 'sensor_msgs/msg/LaserScan', '')")
        database.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id FROM n) "
            "SELECT id, 1 AS topic_id, 0 AS timestamp, x'00' AS data FROM n"
        )
        database.commit()
    with pytest.raises(InputError, match="no plain table"):
        open_log(path)
