# SPDX-License-Identifier: Apache-2.0
"""A recording is known again by its content."""

from __future__ import annotations

import cartoloop
from cartoloop.readers import open_logs
from cartoloop.readers.fingerprint import PART_BYTES, fingerprint, joint_fingerprint


def write(path, content):
    path.write_bytes(content)
    return path


def test_a_copy_of_another_name_is_the_same_recording(tmp_path):
    first, copy = write(tmp_path / "a.bag", b"scans"), write(tmp_path / "b.bag", b"scans")

    assert fingerprint(first) == fingerprint(copy)
    assert len(fingerprint(first)) == 16


def test_beginning_end_and_length_make_the_difference(tmp_path):
    whole = b"a" + bytes(3 * PART_BYTES) + b"z"
    others = [b"b" + whole[1:], whole[:-1] + b"y", whole[:-1] + b"\0z"]
    found = {fingerprint(write(tmp_path / "log", content)) for content in (whole, *others)}

    assert len(found) == 4


def test_a_folder_is_known_by_its_files(tmp_path):
    folder = tmp_path / "recording"
    folder.mkdir()
    (folder / "inside").mkdir()
    write(folder / "metadata.yaml", b"about")
    write(folder / "0.mcap", b"scans")
    before = fingerprint(folder)

    assert fingerprint(folder / "metadata.yaml") == before
    write(folder / "0.mcap", b"more scans")
    assert fingerprint(folder) != before


def test_what_cannot_be_read_has_none(tmp_path):
    assert fingerprint(tmp_path / "nothing") == ""
    assert joint_fingerprint(["", "0123456789abcdef"]) == ""


def test_logs_have_the_fingerprint_of_their_files(tmp_path):
    paths = [tmp_path / "a.log", tmp_path / "b.log"]
    for number, path in enumerate(paths):
        path.write_text(f"FLASER 3 1.0 2.0 3.0 0 0 0 0 0 0 {number}.5 host {number}.5\n" * 2)
    each = [fingerprint(path) for path in paths]

    assert cartoloop.open_log(paths[0]).fingerprint == each[0]
    assert open_logs(paths).fingerprint == joint_fingerprint(each) not in each
