# SPDX-License-Identifier: Apache-2.0
"""The journal as a file that grows, whatever becomes of its folder and its disk."""

from __future__ import annotations

import errno
import os
import shutil

import pytest

from cartoloop.errors import OutputError
from cartoloop.journal.frames import Kind, read_content
from cartoloop.journal.writer import JournalWriter, is_locked


@pytest.fixture
def path(tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    return folder / "journal.cartoloop"


@pytest.fixture
def problems():
    return []


@pytest.fixture
def writer(path, problems, monkeypatch):
    """A writer whose threads never act by themselves."""
    monkeypatch.setattr("cartoloop.journal.writer.WRITE_PERIOD_S", 3600.0)
    monkeypatch.setattr("cartoloop.journal.writer.SYNC_PERIOD_S", 3600.0)
    monkeypatch.setattr("cartoloop.journal.writer.LATE_S", 3600.0)
    made = JournalWriter(path, problems.append, header=b"{}")
    yield made
    made.close()


def payloads(path):
    return [bytes(record.payload) for record in read_content(path).records]


def test_a_new_journal_has_its_header_at_once(writer, path):
    assert [(record.kind, bytes(record.payload)) for record in read_content(path).records] == [
        (Kind.HEADER, b"{}")
    ]


def test_records_are_written_in_their_order(writer, path):
    for number in range(5):
        writer.append(Kind.SCAN, str(number).encode())
        if number == 2:
            writer.flush()
    writer.close()

    assert payloads(path) == [b"{}", b"0", b"1", b"2", b"3", b"4"]


def test_records_are_written_by_themselves(path, problems, monkeypatch):
    monkeypatch.setattr("cartoloop.journal.writer.WRITE_PERIOD_S", 0.001)
    writer = JournalWriter(path, problems.append, header=b"{}")
    writer.append(Kind.SCAN, b"a")
    while len(payloads(path)) < 2:
        pass
    writer.close()


def test_a_record_is_written_where_the_thread_is_late(writer, path, monkeypatch):
    writer.append(Kind.SCAN, b"a")
    assert payloads(path) == [b"{}"]
    monkeypatch.setattr("cartoloop.journal.writer.LATE_S", 0.0)
    writer.flush()
    writer.append(Kind.SCAN, b"b")

    assert payloads(path) == [b"{}", b"a", b"b"]


def test_a_torn_end_is_replaced(writer, path, problems):
    writer.append(Kind.SCAN, b"a")
    writer.close()
    size = path.stat().st_size
    path.write_bytes(path.read_bytes() + b"torn")

    again = JournalWriter(path, problems.append, kept_size=lambda: read_content(path).size)
    assert path.stat().st_size == size
    again.append(Kind.SCAN, b"b")
    again.close()

    assert payloads(path) == [b"{}", b"a", b"b"]


def test_two_runs_never_write_the_same_journal(writer, path, problems):
    assert is_locked(path)
    with pytest.raises(OutputError, match="another run writes there"):
        JournalWriter(path, problems.append, header=b"other")
    with pytest.raises(OutputError, match="another run writes there"):
        JournalWriter(path, problems.append, kept_size=lambda: 0)
    writer.close()

    assert not is_locked(path)
    assert payloads(path) == [b"{}"]


def test_a_full_disk_delays_what_is_written(writer, path, problems, monkeypatch):
    write = os.write

    def full(descriptor, data):
        write(descriptor, bytes(data)[:3])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("cartoloop.journal.writer.os.write", full)
    for number in (b"1", b"2"):
        writer.append(Kind.SCAN, number)
        writer.flush()
        assert payloads(path) == [b"{}"]
    assert len(problems) == 1
    assert "No space left on device; it is tried again" in problems[0]

    monkeypatch.setattr("cartoloop.journal.writer.os.write", write)
    writer.append(Kind.SCAN, b"3")
    writer.flush()

    assert payloads(path) == [b"{}", b"1", b"2", b"3"]


def test_a_journal_ends_where_too_much_waits(writer, path, monkeypatch):
    monkeypatch.setattr("cartoloop.journal.writer.MAX_WAITING_BYTES", 10)
    shutil.rmtree(path.parent)
    path.parent.write_text("a file in its place")
    writer.append(Kind.SCAN, b"a long record")
    writer.flush()
    writer.append(Kind.SCAN, b"lost")
    path.parent.unlink()
    writer.flush()

    assert payloads(path) == [b"{}", b"a long record"]


def test_a_removed_folder_is_made_again(writer, path, problems):
    writer.append(Kind.SCAN, b"a")
    writer.flush()
    shutil.rmtree(path.parent)
    writer.append(Kind.SCAN, b"b")
    writer.flush()

    assert payloads(path) == [b"{}", b"a", b"b"]
    assert is_locked(path)
    assert not problems


def test_a_journal_of_another_run_is_not_replaced(writer, path, problems):
    writer.append(Kind.SCAN, b"a")
    path.unlink()
    other = JournalWriter(path, problems.append, header=b"other")
    writer.flush()
    other.close()

    assert payloads(path) == [b"other"]
    assert "another run writes there" in problems[0]


def test_what_a_run_killed_at_once_left_is_removed(path, problems):
    left = path.with_name(f".{path.name}.12061")
    left.write_bytes(b"half of a head")

    JournalWriter(path, problems.append, header=b"{}").close()

    assert [each.name for each in path.parent.iterdir()] == [path.name]


def test_a_journal_that_another_run_begins_is_kept(path, problems):
    begun = path.with_name(f".{path.name}.12061")
    other = JournalWriter(begun, problems.append, header=b"{}")

    JournalWriter(path, problems.append, header=b"{}").close()
    other.close()

    assert begun.exists()


def test_a_journal_is_removed_at_the_end(writer, path):
    writer.remove()

    assert list(path.parent.iterdir()) == []
