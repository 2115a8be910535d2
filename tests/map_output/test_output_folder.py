# SPDX-License-Identifier: Apache-2.0
"""What a run may replace in its folder, and where it saves otherwise."""

from __future__ import annotations

import json
import os
from dataclasses import replace

import pytest

from cartoloop.errors import OutputError
from cartoloop.map_file.schema import FILE_NAME
from cartoloop.map_file.write import map_bytes
from cartoloop.map_output.output_folder import RunFolder, map_state, saved_map
from cartoloop.map_output.save import save
from cartoloop.report import InputSummary, Report
from tests.map_output.small_result import small_result

MINE, OTHER = "0123456789abcdef", "fedcba9876543210"


def saved(folder, fingerprint=MINE, *, finished=True, name="my.log"):
    report = Report(input=InputSummary(name), finished=finished, fingerprint=fingerprint)
    save(replace(small_result(), report=report), folder)
    return folder


def run(folder, *, overwrite=False, name="my.log"):
    return RunFolder(folder, name, MINE, overwrite)


def test_the_map_of_the_same_recording_is_replaced(tmp_path):
    saved(tmp_path, name="another-name.log")

    run(tmp_path).check()

    assert run(tmp_path).place(finished=True) == tmp_path


def test_the_map_of_another_recording_is_refused(tmp_path):
    saved(tmp_path, OTHER)

    with pytest.raises(OutputError, match=r"holds another map \(of my\.log\).*--overwrite"):
        run(tmp_path).check()

    run(tmp_path, overwrite=True).check()
    assert run(tmp_path, overwrite=True).place(finished=True) == tmp_path


def test_of_earlier_versions_the_name_decides(tmp_path):
    saved(tmp_path, "")

    run(tmp_path).check()
    with pytest.raises(OutputError, match="holds another map"):
        run(tmp_path, name="your.log").check()


def test_a_map_that_a_program_made_is_refused(tmp_path):
    saved(tmp_path, "", name="")

    with pytest.raises(OutputError, match=r"holds another map \(of a program\)"):
        run(tmp_path).check()


def test_files_of_other_programs_are_refused(tmp_path):
    (tmp_path / "map.pgm").write_text("a drawing")
    (tmp_path / "notes.txt").write_text("no file of a map")

    with pytest.raises(OutputError, match=r"files that would be replaced \(map\.pgm\)"):
        run(tmp_path).check()


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_stopped_run_is_saved_beside_a_finished_map(tmp_path, overwrite):
    saved(tmp_path)

    place = run(tmp_path, overwrite=overwrite).place(finished=False)

    assert place == tmp_path / "stopped"
    assert place.is_dir()
    why = run(tmp_path).why(place)
    assert why == f", since {tmp_path} holds a finished map"


def test_a_stopped_run_replaces_another_stopped_one(tmp_path):
    saved(tmp_path, finished=False)

    assert run(tmp_path).place(finished=False) == tmp_path
    assert run(tmp_path).why(tmp_path) == ""


def test_a_map_that_came_meanwhile_is_kept(tmp_path):
    run(tmp_path).check()
    saved(tmp_path, OTHER)

    assert run(tmp_path).place(finished=True) == tmp_path / "second"


def test_a_base_that_was_edited_meanwhile_is_kept(tmp_path):
    saved(tmp_path)
    adding = replace(run(tmp_path), adds=True, added_to=map_state(tmp_path))
    adding.check()
    assert adding.place(finished=True) == tmp_path

    saved(tmp_path, name="edited.log")

    assert adding.place(finished=True) == tmp_path / "second"
    assert "changed by another program" in adding.why(tmp_path / "second")
    adding.check_base(tmp_path / "second")
    with pytest.raises(OutputError, match="changed by another program"):
        adding.check_base(tmp_path)


def test_a_live_map_without_a_report_is_known(tmp_path):
    report = Report(input=InputSummary("robot"), fingerprint=OTHER)
    (tmp_path / FILE_NAME).write_bytes(map_bytes(replace(small_result(), report=report)))

    found = saved_map(tmp_path)

    assert (found.files, found.name, found.fingerprint) == ((FILE_NAME,), "robot", OTHER)
    assert not found.finished


@pytest.mark.parametrize("content", [b"", b"[]", b"\xff", json.dumps({"input": 3}).encode()])
def test_a_damaged_report_protects_its_folder(tmp_path, content):
    (tmp_path / "report.json").write_bytes(content)

    with pytest.raises(OutputError, match="--overwrite"):
        run(tmp_path).check()


def test_a_check_makes_nothing(tmp_path):
    run(tmp_path / "new" / "out").check()

    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_place_of_a_file_is_refused(tmp_path):
    (tmp_path / "map.png").mkdir()

    with pytest.raises(OutputError, match=r"map\.png: is a folder where a file"):
        run(tmp_path).check()


@pytest.mark.parametrize("name", ["file", "file/out"])
def test_a_folder_that_cannot_be_is_refused_first(tmp_path, name):
    (tmp_path / "file").write_text("not a folder")

    with pytest.raises(OutputError, match="cannot write there"):
        run(tmp_path / name).check()


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere"
)
def test_a_folder_in_one_without_permission_is_refused(tmp_path):
    tmp_path.chmod(0o500)

    with pytest.raises(OutputError, match="nothing can be made in"):
        run(tmp_path / "out").check()
