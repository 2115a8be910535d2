# SPDX-License-Identifier: Apache-2.0
"""``cartoloop edit``: all files of a map follow each edit, and its undoing."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cartoloop
from cartoloop.cli.edit_group import with_command_first
from cartoloop.cli.main import run
from cartoloop.errors import InputError, OutputError
from cartoloop.map_output.output_folder import RunFolder
from tests.map_editing.edited_map import finished_map
from tests.map_output.small_result import FILES

COMMANDS = {"list", "drop", "undo"}


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("edit") / "saved"
    finished_map().save(folder)
    return folder


@pytest.fixture
def out(tmp_path, saved):
    return Path(shutil.copytree(saved, tmp_path / "out"))


@pytest.fixture
def edit(out, capsys):
    def call(*arguments):
        status = run(["edit", str(out), *arguments])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return status, captured.out, captured.err

    return call


def contents(folder):
    return {name: (folder / name).read_bytes() for name in FILES}


CHANGES = {
    ("drop", "2"): {"map.pgm", "trajectory.tum", "graph.g2o", "closures.csv"},
    ("pin", "--node", "2", "--at", "1,2,90"): {"map.pgm", "trajectory.tum", "graph.g2o"},
    ("control-points", "--point", "0,0=-5,3", "--point", "8,0=3,3.1"): {"trajectory.tum"},
    ("align",): {"map.pgm", "trajectory.tum", "graph.g2o"},
    ("forget", "--from", "103", "--to", "104"): {"trajectory.tum", "nodes.csv", "graph.g2o"},
    ("forget", "--area", "0.5", "0.3", "1.5", "1.2"): {"map.pgm", "map.png"},
    ("split", "0", "--at", "102.5"): {"map.cartoloop"},
    ("rename", "0", "morning"): {"map.cartoloop"},
}


@pytest.mark.parametrize("arguments", CHANGES, ids=" ".join)
def test_all_files_follow_an_edit_and_its_undoing(arguments, out, edit):
    before = contents(out)
    assert edit(*arguments, "--dry-run")[0] == 0
    assert contents(out) == before

    status, printed, _ = edit(*arguments)
    assert status == 0
    assert printed.startswith("edit 0: ")
    edited = contents(out)
    changed = {name for name in FILES if edited[name] != before[name]}
    assert changed >= {*CHANGES[arguments], "map.cartoloop", "report.json"}
    assert "config.toml" not in changed

    assert edit("undo")[0] == 0
    undone = contents(out)
    assert {name for name in FILES if undone[name] != before[name]} == {"map.cartoloop"}

    assert edit("redo", "0")[0] == 0
    again = contents(out)
    assert {name for name in FILES if again[name] != edited[name]} == set()


def test_edits_are_listed(edit):
    assert edit()[1].startswith("no edits\nsession 0: a.log, from 100.000")
    edit("drop", "2")
    edit("rename", "0", "morning")
    edit("undo", "0")

    _, printed, _ = edit("list")
    assert printed.splitlines() == [
        "edit 0: drop closure submap 1 - node 5 (undone)",
        "edit 1: call the session that begins with scan 0 morning",
        "session 0: morning, from 100.000",
    ]
    listed = json.loads(edit("list", "--json")[1])
    assert listed["edits"][0]["arguments"] == {"pairs": [[1, 5]]}


def test_closures_are_listed_with_their_fates(edit):
    edit("drop", "2")
    lines = edit("closures")[1].splitlines()
    removed = json.loads(edit("closures", "--status", "removed", "--json")[1])
    worst = json.loads(edit("closures", "--worst", "2", "--json")[1])

    assert len(lines) == 1 + 5
    assert lines[3].endswith("removed: edit")
    assert [row["number"] for row in removed] == [2]
    assert [row["is_in_graph"] for row in worst] == [True, True]
    assert worst[0]["residual_m"] >= worst[1]["residual_m"]
    assert [row["node"] for row in json.loads(edit("closures", "--node", "4", "--json")[1])] == [4]


def test_a_file_of_control_points_is_read(out, edit, tmp_path):
    file = tmp_path / "survey.txt"
    file.write_text("# x y X Y\n0 0 100 50\n8 0 100 58  # the far corner\n")
    status, printed, _ = edit("control-points", str(file))

    assert status == 0
    assert "point 2: residual" in printed
    assert cartoloop.load(out).graph.node_poses[0, :2] == pytest.approx((100, 50), abs=0.01)


def test_a_byte_order_mark_before_control_points(edit, tmp_path):
    file = tmp_path / "survey.txt"
    file.write_bytes("\ufeff0 0 100 50\r\n8 0 100 58\r\n".encode())

    assert edit("control-points", str(file))[0] == 0


def test_a_session_is_forgotten(out, edit):
    edit("split", "0", "--at", "102.5", "--name", "afternoon")
    printed = edit("forget", "--session", "1", "--from", "100", "--to", "103")[1]
    assert "  -1 scans, -1 nodes, -30 returns of nodes" in printed
    edit("forget", "--session", "0")

    assert [one.name for one in cartoloop.load(out).sessions] == ["afternoon"]
    assert len(cartoloop.load(out).stamps) == 2


def test_explain_says_that_a_closure_was_removed(out, edit, capsys):
    edit("drop", "2")
    run(["explain", str(out), "--closure", "2"])

    assert "Removed from the graph by an edit of the map" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "status", "says"),
    [
        (("drop", "99"), 1, "the record has 5 rows"),
        (("drop", "4"), 1, "is not in the graph (contradicted"),
        (("pin",), 2, "give one of --node N and --submap N"),
        (("pin", "--node", "9"), 1, "the map has nodes 0 to 5"),
        (("forget",), 2, "give either --from"),
        (("forget", "--from", "101"), 2, "give both"),
        (("forget", "--from", "0", "--to", "1"), 1, "no scan has a stamp"),
        (("forget", "--area", "50", "50", "51", "51"), 1, "shows nothing from x 50 to 51 m"),
        (("forget", "--area", "0", "0", "1", "1", "--session", "0"), 2, "give either --from"),
        (("forget", "--session", "0", "--to", "101"), 2, "give both"),
        (("forget", "--session", "1"), 1, "the map has sessions 0 to 0"),
        (("control-points", "--point", "0,0=1,1"), 2, "two or more points"),
        (("control-points", "--point", "here"), 2, "is not X,Y=X,Y"),
        (("undo",), 1, "there is no edit to undo"),
        (("redo", "0"), 1, "the map has no edits"),
        (("closures", "--status", "good"), 1, "choose from"),
        (("explode",), 2, "No such command 'explode'"),
    ],
)
def test_what_cannot_be_done_is_one_line(edit, arguments, status, says):
    code, printed, error = edit(*arguments)

    assert code == status
    assert says in " ".join(error.split())
    assert printed == ""


def test_a_folder_without_a_map_is_refused(tmp_path, capsys):
    assert run(["edit", str(tmp_path)]) == 1
    assert "has no map.cartoloop" in capsys.readouterr().err


def test_an_interrupted_run_is_to_be_finished_first(tmp_path, capsys):
    (tmp_path / "journal.cartoloop").write_bytes(b"cartoloop run")

    assert run(["edit", str(tmp_path), "align"]) == 1
    assert "finish it with --resume, then edit it" in capsys.readouterr().err


def test_an_unfinished_map_is_refused(tmp_path, capsys):
    result = finished_map()
    replace(result, report=replace(result.report, finished=False)).save(tmp_path)

    assert run(["edit", str(tmp_path), "align"]) == 1
    assert "mapping was stopped before its end" in capsys.readouterr().err


def test_the_change_of_another_program_is_not_lost(out):
    mine, other = cartoloop.edit(out), cartoloop.edit(out)
    mine.align()
    other.drop_closures(2)
    other.save()

    with pytest.raises(OutputError, match="was changed by another program"):
        mine.save()
    assert [edit.kind for edit in cartoloop.edit(out).edits] == ["drop"]


def test_python_edits_and_saves_at_the_end_of_a_block(out):
    with cartoloop.edit(out) as editor:
        editor.drop_closures(2)
        editor.pin_node(0, (1.0, 2.0, 0.0))
    loaded, original = cartoloop.load(out), cartoloop.load_map(out, edits=False)

    assert loaded.graph.node_poses[0, :2] == pytest.approx((1.0, 2.0))
    assert np.array_equal(original.graph.node_poses, finished_map().graph.node_poses)


def test_python_saves_nothing_where_a_block_fails(out):
    before = contents(out)
    with pytest.raises(InputError), cartoloop.edit(out) as editor:
        editor.align()
        editor.drop_closures(99)

    assert contents(out) == before


def test_times_of_the_run_stay_in_the_report(out, edit):
    report = json.loads((out / "report.json").read_bytes())
    report["wall_s"], report["stages"] = 12.5, {}
    (out / "report.json").write_text(json.dumps(report))
    edit("align")
    after = json.loads((out / "report.json").read_bytes())

    assert after["wall_s"] == 12.5
    assert len(after["edits"]) == 1


def test_a_map_can_be_edited_through_its_file(out, capsys):
    assert run(["edit", os.fspath(out / "map.cartoloop"), "align"]) == 0
    assert len(json.loads((out / "report.json").read_bytes())["edits"]) == 1


def test_mapping_again_does_not_replace_an_edited_map(out, edit):
    folder = RunFolder(out, "a.log", "")
    folder.check()
    edit("align")
    with pytest.raises(OutputError, match=r"that was edited \(1 edits\)"):
        folder.check()
    edit("undo")
    folder.check()


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (["out"], ["list", "out"]),
        (["out", "--json"], ["list", "out", "--json"]),
        (["out", "drop", "3"], ["drop", "out", "3"]),
        (["drop", "out", "3"], ["drop", "out", "3"]),
        (["drop", "--help"], ["drop", "--help"]),
        (["undo", "list"], ["list", "undo"]),
        (["--help"], ["--help"]),
        ([], []),
    ],
)
def test_the_folder_stands_before_the_command(given, meant):
    assert with_command_first(given, COMMANDS) == meant


def test_a_shell_completes_commands_after_the_folder():
    assert with_command_first(["out"], COMMANDS, is_completion=True) == []


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("closures", "--status", "bogus"), "no status 'bogus': choose from"),
        (("rename", "0", "a\nb"), "the name is 'a\\nb': give 1 to 200 plain characters"),
        (
            ("pin", "--node", "0", "--at", "1e300,0,0"),
            "the pose is x 1e+300 m, y 0 m: a coordinate",
        ),
    ],
)
def test_refusals_name_no_python_types(edit, arguments, says):
    status, _, err = edit(*arguments)

    assert status == 1
    assert says in err
