# SPDX-License-Identifier: Apache-2.0
"""``cartoloop evaluate trajectory`` and what ``evaluate relations`` adds to table II."""

from __future__ import annotations

import json
import math
import sys

import pytest

from cartoloop.cli.main import run


@pytest.fixture
def files(tmp_path):
    """A drive of 20 m along x, an estimate that is 1 % long, and the local one, 5 % long."""

    def write(name, scale):
        lines = [f"{10 + i} {i * scale:.6f} 0 0 0 0 0 1" for i in range(21)]
        (tmp_path / name).write_text("\n".join(lines) + "\n")

    write("truth.tum", 1.0)
    write("estimate.tum", 1.01)
    write("local.tum", 1.05)
    relations = [f"{10 + i} {11 + i} 1 0 0 0 0 {math.radians(i)}" for i in range(20)]
    (tmp_path / "some.relations").write_text("\n".join(relations) + "\n")
    return {path.stem: str(path) for path in tmp_path.iterdir()}


def test_trajectory_prints_absolute_and_relative_errors(files, capsys):
    assert run(["evaluate", "trajectory", files["estimate"], files["truth"]]) == 0

    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["Absolute", "error,", "aligned", "21", "poses"]
    assert "Relative error over 1 m" in lines[9]
    # aligned, the ends are 0.01 * 10 m off
    assert [line for line in lines if line.startswith("  greatest")] == [
        f"  {'greatest':<29}0.1000 m   0.000 deg",
        f"  {'greatest':<29}0.0100 m   0.000 deg",
    ]


def test_trajectory_as_json(files, capsys):
    arguments = ["--json", "--no-align", "--delta", "2", "--delta-unit", "frames", "--consecutive"]

    assert run(["evaluate", "trajectory", files["estimate"], files["truth"], *arguments]) == 0

    error = json.loads(capsys.readouterr().out)
    assert error["aligned"] is False
    assert error["ate"]["translation"]["max"] == pytest.approx(0.2)
    assert error["rpe"]["num_pairs"] == 10
    assert error["rpe"]["delta_unit"] == "frames"
    assert error["rpe"]["translation"]["rmse"] == pytest.approx(0.02)


@pytest.mark.parametrize("name", ["plot.png", "plot.svg"])
def test_trajectory_draws_a_plot(files, tmp_path, name):
    plot = tmp_path / name

    status = run(["evaluate", "trajectory", files["estimate"], files["truth"], "--plot", str(plot)])

    assert status == 0
    assert plot.read_bytes().startswith((b"\x89PNG", b"<?xml"))


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["--delta", "500"], 1, "no two of the 21 common poses are 500 m apart"),
        (["--plot", "a.pdf"], 2, "a name that ends in .png or .svg"),
        (["--plot", "/none/a.png"], 1, "cannot be written"),
        (["--delta", "0.5", "--delta-unit", "frames"], 2, "whole number"),
        (["--delta", "nan", "--delta-unit", "frames"], 2, "whole number"),
        (["--delta", "inf", "--delta-unit", "frames"], 2, "whole number"),
        (["--delta", "nan"], 2, "above 0"),
        (["--max-difference", "-1"], 2, "give 0 s or more"),
    ],
)
def test_trajectory_errors_are_one_line(files, capsys, arguments, status, message):
    assert run(["evaluate", "trajectory", files["estimate"], files["truth"], *arguments]) == status

    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert message in captured.err


def test_unmatched_poses_are_reported(files, tmp_path, capsys):
    other = tmp_path / "other.tum"
    other.write_text("".join(f"{20 + i} {i} 0 0 0 0 0 1\n" for i in range(15)))

    assert run(["evaluate", "trajectory", str(other), files["truth"], "--json"]) == 0

    captured = capsys.readouterr()
    error = json.loads(captured.out)
    assert (error["num_poses"], error["num_missing"]) == (11, 4)
    assert captured.err.count("\n") == 1
    assert "4 of 15 poses do not count" in captured.err


def test_relations_before_and_after_stand_side_by_side(files, capsys):
    arguments = ["evaluate", "relations", files["estimate"], files["some"]]

    assert run([*arguments, "--before", files["local"]]) == 0

    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split("  ")[-1].strip() == "Before"
    assert " ".join(lines[2].split()) == (
        "Absolute translational error 0.0100 +- 0.0000 m 0.0500 +- 0.0000 m"
    )
    assert " ".join(lines[-1].split()) == "All within 0.0100 m, 19.000 deg 0.0500 m, 19.000 deg"


def test_relations_before_and_after_in_json(files, capsys):
    arguments = ["evaluate", "relations", files["estimate"], files["some"], "--json"]
    assert run(arguments) == 0
    alone = json.loads(capsys.readouterr().out)

    assert run([*arguments, "--before", files["local"]]) == 0

    error = json.loads(capsys.readouterr().out)
    before = error.pop("before")
    assert error == alone
    assert before.keys() == alone.keys()
    assert before["absolute_translational"]["mean"] == pytest.approx(0.05)


def test_relations_draw_a_plot(files, tmp_path):
    arguments = ["evaluate", "relations", files["estimate"], files["some"]]
    plots = [tmp_path / "one.svg", tmp_path / "two.svg"]

    assert run([*arguments, "--plot", str(plots[0])]) == 0
    assert run([*arguments, "--before", files["local"], "--plot", str(plots[1])]) == 0

    assert "some.relations: 20 relations" in plots[0].read_text()
    assert "after loop closure" in plots[1].read_text()


def test_without_matplotlib_a_plot_is_an_error_before_any_work(files, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    arguments = ["evaluate", "relations", files["estimate"], files["some"]]

    assert run([*arguments, "--plot", "a.png"]) == 1

    captured = capsys.readouterr()
    assert captured.out == ""
    assert "pip install 'cartoloop[plot]'" in captured.err
    assert run(arguments) == 0
