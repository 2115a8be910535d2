# SPDX-License-Identifier: Apache-2.0
"""The help of all commands, the completion of shells, and options that got new names."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from cartoloop.cli import completion
from cartoloop.cli.main import run
from cartoloop.cli.program import make_program
from cartoloop.simulation import LIDARS, WORLDS

FOLDER = Path(__file__).parents[2]
ROOT = typer.main.get_command(make_program())


def commands(group=ROOT, path=()):
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


COMMANDS = dict(commands())
EXAMPLES = [
    (path, line.strip())
    for path, command in COMMANDS.items()
    for line in (command.epilog or "").splitlines()
    if line.startswith("  cartoloop ")
]


def documented():
    """Yield the command lines in the blocks of code of the documents."""
    for path in (FOLDER / "README.md", *sorted((FOLDER / "docs").glob("*.md"))):
        for block in re.findall(r"^```\n(.*?)^```", path.read_text(), re.MULTILINE | re.DOTALL):
            for line in re.findall(r"^cartoloop .*(?:\\\n.*)*", block, re.MULTILINE):
                yield line.replace("\\\n", " ").partition(" #")[0]


DOCUMENTED = sorted(set(documented()))


def parse(command, args):
    """Return the context of the command that the arguments name, parsed but not run."""
    context = command.make_context("cartoloop", args)
    while hasattr(context.command, "commands"):
        first = getattr(context, "_protected_args", None)  # of recent versions of click
        rest = [*(context.protected_args if first is None else first), *context.args]
        name, sub, args = context.command.resolve_command(context, rest)
        context = sub.make_context(name, args, parent=context)
    return context


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_help_ends_with_one_or_two_examples(path, capsys):
    own = [example for of, example in EXAMPLES if of == path]

    assert 1 <= len(own) <= 2
    assert run([*path, "--help"]) == 0
    assert capsys.readouterr().out.rstrip().endswith(f"\n    {own[-1]}")


@pytest.mark.parametrize(("path", "example"), EXAMPLES, ids=[line for _, line in EXAMPLES])
def test_every_example_is_understood(path, example, capsys):
    program, *args = shlex.split(example)
    context = parse(ROOT, args)

    assert program == "cartoloop"
    assert context.command is COMMANDS[path]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("line", DOCUMENTED)
def test_commands_in_documents_are_understood(line, capsys):
    assert parse(ROOT, shlex.split(line)[1:]).command in COMMANDS.values()
    assert capsys.readouterr().err == ""


def test_documents_show_the_commands():
    shown = {line.split()[1] for line in DOCUMENTED}

    assert shown >= {"map", "live", "view", "info", "export", "simulate"}


@pytest.mark.parametrize("group", [[], ["evaluate"], ["config"]])
def test_help_of_groups_is_not_cut(group, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert run([*group, "--help"]) == 0

    text = " ".join(capsys.readouterr().out.split())
    assert "..." not in text.replace("[ARGS]...", "")
    for path, command in COMMANDS.items():
        if list(path[:-1]) == group:
            assert command.get_short_help_str(1000) in text


def test_help_lists_commands_and_options_in_groups(capsys):
    run(["--help"])
    of_all = capsys.readouterr().out
    run(["live", "--help"])
    of_live = capsys.readouterr().out

    assert re.findall(r"^(\w.*):$", of_all, re.MULTILINE)[1:] == [
        "Make a map",
        "Use a map",
        "Recordings and parameters",
    ]
    titles = ["Arguments", "Options", "Messages", "View", "Recording", "Configuration"]
    assert re.findall(r"^(\w.*):$", of_live, re.MULTILINE) == titles


@pytest.mark.parametrize("path", [[], ["map"], ["evaluate"], ["evaluate", "lines"]])
def test_help_has_a_short_name(path, capsys):
    assert run([*path, "-h"]) == 0
    assert "Usage: cartoloop" in capsys.readouterr().out


def test_another_program_keeps_its_name(capsys):
    program = typer.Typer(rich_markup_mode=None)
    program.command()(lambda: None)

    assert run(["--help"], program) == 0
    assert "Usage: cartoloop" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("args", "old", "new", "field", "value"),
    [
        (["map", "a.log", "-o", "a", "--view"], "--host", "--view-host", "view_host", "0.0.0.0"),
        (["map", "a.log", "-o", "a", "--view"], "--port", "--view-port", "view_port", 9000),
        (["view", "a"], "--host", "--view-host", "view_host", "0.0.0.0"),
        (["live", "-", "-o", "a"], "--host", "--source-host", "source_host", "0.0.0.0"),
        (["live", "-", "-o", "a", "--view"], "--port", "--view-port", "view_port", 9000),
    ],
)
def test_old_names_of_options_work_and_warn(args, old, new, field, value, capsys):
    for given in ([old, str(value)], [f"{old}={value}"]):
        assert parse(ROOT, [*args, *given]).params[field] == value
        assert capsys.readouterr().err == f"warning: {old} is now called {new}\n"


def test_old_names_of_options_are_not_shown(capsys):
    for command in ("map", "view", "live"):
        run([command, "--help"])
        assert not re.search(r" --(host|port)\b", capsys.readouterr().out)


def complete(*words, shell="bash"):
    """Return what a shell is offered for the last of these words."""
    environment = {
        "_CARTOLOOP_COMPLETE": f"complete_{shell}",
        "COMP_WORDS": " ".join(words),
        "COMP_CWORD": str(len(words) - 1),
        "_TYPER_COMPLETE_ARGS": " ".join(words),
    }
    done = subprocess.run(
        [sys.executable, "-m", "cartoloop"],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


def test_a_shell_can_complete_commands_and_options():
    assert complete("cartoloop", "ma").split() == ["map"]
    assert complete("cartoloop", "live", "--view-").split() == ["--view-host", "--view-port"]
    assert "verdict, files." in complete("cartoloop", "inf", shell="zsh")  # not cut


def test_a_shell_can_complete_values():
    assert "local_slam.submaps.resolution=" in completion.complete_key("local_slam.subm")
    assert completion.complete_layers("quality,t") == ["quality,trajectory"]
    assert completion.complete_echo("f") == ["first"]
    assert completion.complete_world("") == list(WORLDS)
    assert completion.complete_lidar("sick") == [name for name in LIDARS if "sick" in name]
    assert completion.complete_odometry_fault("frozen") == ["frozen", "frozen-later"]


def test_completion_can_be_installed(tmp_path, capsys):
    done = subprocess.run(
        [sys.executable, "-m", "cartoloop", "--show-completion"],
        env=os.environ | {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"},
        capture_output=True,
        text=True,
        check=False,
    )

    assert "--show-completion" in done.stderr  # without a shell it asks for one
    run(["--help"])
    assert "--install-completion" in capsys.readouterr().out
