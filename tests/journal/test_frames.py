# SPDX-License-Identifier: Apache-2.0
"""The format of a journal: what is whole is read, whatever follows."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.errors import InputError
from cartoloop.journal.frames import MAGIC, PREAMBLE, frame_bytes, read_content, record_bytes

RECORDS = st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=40)), min_size=1, max_size=4)


def frame(records):
    return frame_bytes([record_bytes(kind, payload) for kind, payload in records])


def content(path, data):
    path.write_bytes(data)
    found = read_content(path)
    return [(record.kind, bytes(record.payload)) for record in found.records], found.size


@given(st.lists(RECORDS, max_size=4), st.data())
def test_a_cut_journal_has_its_whole_frames(tmp_path_factory, frames, data):
    path = tmp_path_factory.mktemp("frames") / "journal"
    whole = [frame(records) for records in frames]
    cut = data.draw(st.integers(len(PREAMBLE), len(PREAMBLE) + sum(map(len, whole))))
    end, expected = len(PREAMBLE), []
    for records, each in zip(frames, whole, strict=True):
        if end + len(each) > cut:
            break
        end += len(each)
        expected += records

    assert content(path, (PREAMBLE + b"".join(whole))[:cut]) == (expected, end)


@given(RECORDS, RECORDS, st.data())
def test_a_changed_byte_ends_a_journal(tmp_path_factory, first, second, data):
    path = tmp_path_factory.mktemp("frames") / "journal"
    one, other = frame(first), bytearray(frame(second))
    other[data.draw(st.integers(0, len(other) - 1))] ^= data.draw(st.integers(1, 255))

    records, size = content(path, PREAMBLE + one + bytes(other))

    assert records[: len(first)] == first
    assert size in (len(PREAMBLE) + len(one), len(PREAMBLE) + len(one) + len(other))
    assert size == len(PREAMBLE) + len(one) or not any(other[8:])


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "journal"
    for data, reason in (
        (b"", "is no journal"),
        (b"SQLite format 3\0", "is no journal"),
        (MAGIC.replace(b"\r\n", b"\n") + struct.pack("<I", 1), "is no journal"),
        (MAGIC + struct.pack("<I", 99), "is of version 99"),
    ):
        path.write_bytes(data)
        with pytest.raises(InputError, match=reason):
            read_content(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_content(tmp_path / "gone")
