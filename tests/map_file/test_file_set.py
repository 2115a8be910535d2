# SPDX-License-Identifier: Apache-2.0
"""The files of a map change as one: at no moment does one of a former map lie beside a new one."""

from __future__ import annotations

from pathlib import Path

import pytest

from cartoloop.errors import OutputError
from cartoloop.map_file.file_set import (
    FILES,
    new_file_set,
    remove_file_set,
    repair_file_set,
    replaced_files,
    require_no_map_file,
)
from cartoloop.stop_request import StopRequest
from tests.map_output.small_result import FILES as ALL_FILES


class Killed(BaseException):
    """Ends the program at once."""


def write(folder, content):
    for name in FILES:
        (folder / name).write_text(content)


def contents(folder):
    """The different contents of the files of a map."""
    return {(folder / name).read_text() for name in FILES if (folder / name).exists()}


def save(folder, content, stop=None):
    with new_file_set(folder, stop) as beside:
        write(beside, content)


@pytest.fixture
def folder(tmp_path):
    write(tmp_path, "old")
    (tmp_path / "notes.txt").write_text("mine")
    return tmp_path


def kill_at(step, monkeypatch):
    """Let the program be killed at a step that changes names."""
    left = [step]

    def killing(original):
        def changed(*arguments, **options):
            left[0] -= 1
            if left[0] < 0:
                raise Killed
            return original(*arguments, **options)

        return changed

    for name in ("rename", "replace", "unlink", "rmdir"):
        monkeypatch.setattr(Path, name, killing(getattr(Path, name)))


def test_the_list_names_all_files_of_a_map():
    assert set(FILES) == ALL_FILES


def test_new_files_replace_the_old_ones_and_no_others(folder):
    save(folder, "new")

    assert contents(folder) == {"new"}
    assert {path.name for path in folder.iterdir()} == {*FILES, "notes.txt"}


def test_a_kill_at_any_step_leaves_no_mixed_set(folder):
    num_steps = 2 * len(FILES) + 3  # removed and moved, and three folders renamed or removed
    for step in range(num_steps):
        write(folder, "old")
        with pytest.MonkeyPatch.context() as patch:
            kill_at(step, patch)
            with pytest.raises(Killed):
                save(folder, "new")
        assert len(contents(folder)) <= 1, step

        repair_file_set(folder)

        assert contents(folder) == ({"new"} if step else {"old"})
        assert all((folder / name).exists() for name in FILES)
    save(folder, "last")
    assert {path.name for path in folder.iterdir()} == {*FILES, "notes.txt"}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_failure_before_the_end_keeps_the_old_files(folder, error):
    def fail():
        with new_file_set(folder) as beside:
            (beside / FILES[0]).write_text("new")
            raise error

    with pytest.raises(error):
        fail()

    assert contents(folder) == {"old"}
    assert {path.name for path in folder.iterdir()} == {*FILES, "notes.txt"}


def test_a_full_disk_is_an_output_error(folder):
    def fail():
        with new_file_set(folder):
            raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match="No space left on device; choose another"):
        fail()
    assert contents(folder) == {"old"}


def test_a_stop_while_files_are_replaced_is_only_noted(folder, monkeypatch):
    stop, seen = StopRequest(), []
    rename = Path.rename

    def watched(path, target):
        seen.append(stop.is_shielded)
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", watched)
    save(folder, "new", stop)

    assert seen == [True, True]
    assert not stop.is_shielded


def test_what_a_killed_program_left_half_written_is_removed(folder):
    (folder / ".unfinished").mkdir()
    (folder / ".unfinished" / "map.png").write_text("half")

    save(folder, "new")

    assert not (folder / ".unfinished").exists()


def test_removing_a_map_keeps_other_files(folder):
    remove_file_set(folder)
    assert [path.name for path in folder.iterdir()] == ["notes.txt"]

    (folder / "notes.txt").unlink()
    remove_file_set(folder)
    assert not folder.exists()


SOME = ("map.pgm", "map.yaml", "plan.png")


def replace_some(folder, content="new"):
    with replaced_files(folder) as beside:
        for name in SOME:
            (beside / name).write_text(content)


def some_contents(folder):
    return {(folder / name).read_text() for name in SOME if (folder / name).exists()}


def test_replaced_files_leave_all_others_in_place(folder):
    replace_some(folder)

    assert some_contents(folder) == {"new"}
    assert (folder / "trajectory.tum").read_text() == "old"
    assert {path.name for path in folder.iterdir()} == {*FILES, *SOME, "notes.txt"}


def test_a_kill_while_some_files_are_replaced_mixes_none(folder):
    num_steps = 2 * len(SOME) + 3
    for step in range(num_steps):
        replace_some(folder, "old")
        with pytest.MonkeyPatch.context() as patch:
            kill_at(step, patch)
            with pytest.raises(Killed):
                replace_some(folder)
        assert len(some_contents(folder)) <= 1, step

        repair_file_set(folder)

        assert some_contents(folder) == ({"new"} if step else {"old"})
        assert (folder / "trajectory.tum").read_text() == "old"
        assert all((folder / name).exists() for name in SOME)


def test_a_folder_in_the_place_of_a_file_changes_nothing(tmp_path):
    (tmp_path / "plan.png").mkdir()
    (tmp_path / "map.pgm").write_text("old")

    with pytest.raises(OutputError, match=r"plan\.png: cannot be written: Is a directory"):
        replace_some(tmp_path)

    assert {path.name for path in tmp_path.iterdir()} == {"plan.png", "map.pgm"}
    assert (tmp_path / "map.pgm").read_text() == "old"


@pytest.mark.parametrize(
    "name", ["map.cartoloop", "map.pgm", "trajectory.tum", "journal.cartoloop"]
)
def test_single_files_of_a_map_are_not_to_be_written(tmp_path, name):
    require_no_map_file(tmp_path / name)  # there is no map
    (tmp_path / "map.cartoloop").write_bytes(b"map")

    with pytest.raises(OutputError, match="is a file of a map"):
        require_no_map_file(tmp_path / name)
    require_no_map_file(tmp_path / "plan.png")
