# SPDX-License-Identifier: Apache-2.0
"""Text recordings that unpack to far more than they weigh, and lines without end."""

from __future__ import annotations

import gzip

import pytest

from cartoloop.errors import InputError
from cartoloop.readers import open_log
from cartoloop.readers.text_file import MAX_LINE_BYTES, OVERLONG, TextFile

GOOD = b"".join(
    b"FLASER 180 " + b"1.25 " * 180 + b"%d 0 0 %d 0 0 %d host 0\n" % (i, i, i) for i in range(10)
)
ENDLESS = b"FLASER 180 " + b"1.25 " * (30 << 18)


@pytest.mark.parametrize("name", ["a.log", "a.log.gz"])
def test_a_line_that_is_too_long_is_skipped_and_counted(tmp_path, name):
    pack = gzip.compress if name.endswith("gz") else bytes
    path = tmp_path / name
    # Random digits before it, so that the stream is not refused as a bomb.
    comment = b"# " + bytes(ord("0") + (7 * i * i + i) % 10 for i in range(99)) + b"\n"
    long = b"FLASER 180 " + b"1.25 " * (MAX_LINE_BYTES // 4) + b"\n"
    path.write_bytes(pack(comment + GOOD + long + GOOD))
    log = open_log(path)
    assert log.num_scans == 20
    assert len(list(log)) == 40
    assert log.skipped["line too long"] == 1
    assert any("a.log" in p.message and "longer than 4 MB" in p.message for p in log.problems)


def test_a_compressed_line_without_end_is_cut_short(tmp_path):
    path = tmp_path / "a.log.gz"
    path.write_bytes(gzip.compress(GOOD + ENDLESS))
    log = open_log(path)
    assert log.num_scans == 10
    assert any("unpacks to more than 100 times its size" in p.message for p in log.problems)


def test_compressed_empty_lines_are_refused(tmp_path):
    path = tmp_path / "a.log.gz"
    path.write_bytes(gzip.compress(b"\n" * (2 << 20)))
    with pytest.raises(InputError, match="unpacks to empty lines"):
        open_log(path)


def test_pieces_of_a_stream_are_all_unpacked(tmp_path):
    path = tmp_path / "a.log.gz"
    lines = [b"%d " % i + b"x" * (i % 4000) for i in range(10_000)]
    path.write_bytes(gzip.compress(b"\n".join(lines) + b"\n"))
    assert list(TextFile(path).lines()) == lines
    assert list(TextFile(path)._stream_lines()) == lines


def test_only_the_mark_itself_means_an_overlong_line(tmp_path):
    path = tmp_path / "a.log"
    path.write_bytes(bytes(OVERLONG) + b"\n")
    [line] = TextFile(path).lines()
    assert line is not OVERLONG
