# SPDX-License-Identifier: Apache-2.0
"""The command line without mapping: usage, configuration, evaluation, simulation."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib

import pytest

import cartoloop
from cartoloop.cli.main import run

COMMANDS = ("demo", "map", "simulate", "evaluate", "config")


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    """A simulated recording with its truth and relations."""
    folder = tmp_path_factory.mktemp("ring")
    files = {
        "log": folder / "ring.log.gz",
        "truth": folder / "ring.tum",
        "relations": folder / "ring.relations",
    }
    beside = ["--truth", str(files["truth"]), "--relations", str(files["relations"])]
    assert run(["simulate", "ring", "-o", str(files["log"]), *beside]) == 0
    return files


def test_help_names_the_commands_and_imports_nothing_heavy():
    code = (
        "import sys; from cartoloop.cli.main import run; status = run(['--help']);"
        "heavy = {'numba', 'scipy', 'numpy', 'pydantic', 'PIL'} & set(sys.modules);"
        "print(heavy or '', file=sys.stderr); sys.exit(status)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)

    assert done.returncode == 0
    assert done.stderr.strip() == ""
    assert all(f"  {command} " in done.stdout for command in COMMANDS)


def test_runs_as_a_module():
    done = subprocess.run(
        [sys.executable, "-m", "cartoloop", "--version"], capture_output=True, text=True, check=True
    )

    assert done.stdout == f"cartoloop {cartoloop.__version__}\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_has_help(command, capsys):
    assert run([command, "--help"]) == 0
    assert "Usage:" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [
        ["mapp"],
        ["map"],
        ["map", "a.log", "-o", "out", "--draw", "walls"],
        ["map", "a.log", "-o", "out", "--threads", "0"],
        ["map", "a.log", "-o", "out", "--set", "resolution=1"],
        ["evaluate", "relations", "a.tum"],
        ["config", "show", "--set", "local_slam.submaps.resolution=-1"],
        ["config", "check", "none.toml"],
        ["simulate", "castle", "-o", "a.log"],
    ],
)
def test_wrong_usage_exits_with_2_and_says_why(arguments, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    assert run(arguments) == 2

    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err
    assert "Traceback" not in captured.err
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_key_names_the_nearest_in_one_line(capsys):
    assert run(["config", "show", "--set", "local_slam.submap.resolution=0.1"]) == 2

    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "did you mean 'local_slam.submaps.resolution'?" in error


def test_config_show_prints_toml_with_origins(capsys, tmp_path):
    (tmp_path / "mine.toml").write_text("[local_slam.submaps]\nnum_range_data = 30\n")

    status = run(
        ["config", "show", "--config", str(tmp_path / "mine.toml"), "--set", "sensor.max_range=8"]
    )

    text = capsys.readouterr().out
    assert status == 0
    assert tomllib.loads(text)["local_slam"]["submaps"]["num_range_data"] == 30
    assert [
        line.rpartition("(")[2] for line in text.splitlines() if "num_range_data =" in line
    ] == ["file mine.toml)"]
    assert [
        line.rpartition("(")[2] for line in text.splitlines() if line.startswith("max_range = 8")
    ] == ["--set)"]


def test_config_check_accepts_what_config_show_prints(capsys, tmp_path):
    run(["config", "show"])
    (tmp_path / "all.toml").write_text(capsys.readouterr().out)

    assert run(["config", "check", str(tmp_path / "all.toml")]) == 0


def test_simulation_is_the_same_for_the_same_seed(tmp_path):
    for name, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        assert (
            run(["simulate", "corridor", "-o", str(tmp_path / f"{name}.log"), "--seed", seed]) == 0
        )

    first, second, other = ((tmp_path / f"{name}.log").read_bytes() for name in "abc")
    assert first == second
    assert first != other


def test_simulation_into_nowhere_is_an_error(tmp_path, capsys):
    assert run(["simulate", "ring", "-o", str(tmp_path / "none" / "a.log")]) == 1
    assert "cannot write" in capsys.readouterr().err


def test_the_truth_has_no_error(ring, capsys):
    assert run(["evaluate", "relations", str(ring["truth"]), str(ring["relations"]), "--json"]) == 0

    error = json.loads(capsys.readouterr().out)
    assert error["num_missing"] == 0
    assert error["absolute_translational"]["mean"] < 1e-4
    assert error["absolute_rotational_deg"]["mean"] < 1e-2


def test_evaluation_prints_table_ii_and_missing_poses(ring, capsys, tmp_path):
    half = ring["truth"].read_text().splitlines()
    (tmp_path / "half.tum").write_text("\n".join(half[: len(half) // 2]))

    assert run(["evaluate", "relations", str(tmp_path / "half.tum"), str(ring["relations"])]) == 0

    captured = capsys.readouterr()
    rows = [line[:31].strip() for line in captured.out.splitlines()]
    assert rows == [
        "Relations",
        "Absolute translational error",
        "Squared translational error",
        "Absolute rotational error",
        "Squared rotational error",
        *("50 % within", "75 % within", "90 % within", "95 % within", "99 % within"),
        "All within",
    ]
    assert "relations do not count: the trajectory has no pose at" in captured.err


def test_evaluation_of_no_trajectory_is_an_error_in_one_line(ring, capsys):
    assert run(["evaluate", "relations", str(ring["log"]), str(ring["relations"])]) == 1

    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["map", "a.log", "-o", ""], "an argument is empty, after -o: is a variable"),
        (["", "a"], "an argument is empty: is a variable"),
    ],
)
def test_an_empty_argument_is_refused(arguments, says, capsys):
    assert run(arguments) == 2
    assert says in capsys.readouterr().err
