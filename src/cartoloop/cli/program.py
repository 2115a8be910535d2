# SPDX-License-Identifier: Apache-2.0
"""The commands of ``cartoloop``, and the program that is made of them.

To examine the options of all commands takes longer than those of one: a program may have only the
command that it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any, NamedTuple

import typer

from cartoloop.cli.commands import GroupedCommand, add_command, make_app
from cartoloop.cli.config_command import config_app
from cartoloop.cli.demo_command import DemoOptions, demo_command
from cartoloop.cli.doctor_command import DoctorOptions, doctor_command
from cartoloop.cli.edit_command import edit_app
from cartoloop.cli.evaluate_command import evaluate_app
from cartoloop.cli.explain_command import ExplainOptions, explain_command
from cartoloop.cli.export_command import ExportOptions, export_command
from cartoloop.cli.info_command import InfoOptions, info_command
from cartoloop.cli.live_command import LiveCommand, LiveCommandOptions, live_command
from cartoloop.cli.locate_command import LocateOptions, locate_command
from cartoloop.cli.map_command import MapOptions, map_command
from cartoloop.cli.merge_command import MergeOptions, merge_command
from cartoloop.cli.quality_command import QualityOptions, quality_command
from cartoloop.cli.simulate_command import SimulateOptions, simulate_command
from cartoloop.cli.view_command import ViewCommandOptions, ViewingCommand, view_command
from cartoloop.version import __version__

MAKE, USE, RECORDINGS = "Make a map", "Use a map", "Recordings and parameters"
"""Groups of commands in the help."""


class Command(NamedTuple):
    """A command; see :func:`add_command`."""

    name: str
    command: Callable[[Any], None]
    options: type
    examples: Sequence[str]
    group: str
    cls: type[GroupedCommand] = GroupedCommand


COMMANDS = (
    Command(
        "demo",
        demo_command,
        DemoOptions,
        ["cartoloop demo", "cartoloop demo -o office --seed 3"],
        MAKE,
    ),
    Command(
        "map",
        map_command,
        MapOptions,
        [
            "cartoloop map intel.clf.gz -o intel --view",
            "cartoloop map tuesday.bag --scan-topic /scan --onto monday",
        ],
        MAKE,
        ViewingCommand,
    ),
    Command(
        "merge",
        merge_command,
        MergeOptions,
        [
            "cartoloop merge monday tuesday -o week",
            "cartoloop merge robot1 robot2 robot3 -o hall --strict",
        ],
        MAKE,
    ),
    Command(
        "live",
        live_command,
        LiveCommandOptions,
        [
            "cartoloop live tcp://127.0.0.1:7000 -o floor --view",
            "cartoloop live tcp://0.0.0.0:7000 -o floor --source-host 0.0.0.0",
        ],
        MAKE,
        LiveCommand,
    ),
    Command(
        "view",
        view_command,
        ViewCommandOptions,
        ["cartoloop view intel --edit", "cartoloop view intel --view-host 0.0.0.0"],
        USE,
        ViewingCommand,
    ),
    Command(
        "locate",
        locate_command,
        LocateOptions,
        [
            "cartoloop locate intel drive.bag --changes changed --view --speed 1",
            "cartoloop locate map.yaml tcp://127.0.0.1:7000 --at 1.5,-2,90 --poses poses.jsonl",
        ],
        USE,
    ),
    Command(
        "info",
        info_command,
        InfoOptions,
        ["cartoloop info intel", "cartoloop info intel --json"],
        USE,
    ),
    Command(
        "export",
        export_command,
        ExportOptions,
        [
            "cartoloop export intel -o plan.png --resolution 0.02 --rotate auto --crop auto",
            "cartoloop export intel -o kitchen.png --crop -2,-5,4,1 --draw none",
        ],
        USE,
    ),
    Command(
        "quality",
        quality_command,
        QualityOptions,
        ["cartoloop quality intel", "cartoloop quality intel --strict"],
        USE,
    ),
    Command(
        "explain",
        explain_command,
        ExplainOptions,
        ["cartoloop explain intel --pair 3 1200", "cartoloop explain intel --near 4.5 -2"],
        USE,
    ),
    Command(
        "doctor",
        doctor_command,
        DoctorOptions,
        ["cartoloop doctor robot.bag", "cartoloop doctor *.log --json"],
        RECORDINGS,
    ),
    Command(
        "simulate",
        simulate_command,
        SimulateOptions,
        [
            "cartoloop simulate office -o office.log.gz --truth office.tum",
            "cartoloop simulate museum -o walk.bag --tilt-deg 8 --distort",
        ],
        RECORDINGS,
    ),
)

GROUPS = {
    "edit": (edit_app, USE),
    "evaluate": (evaluate_app, USE),
    "config": (config_app, RECORDINGS),
}
"""Commands with commands of their own, and their group in the help."""


def make_program(only: str | None = None) -> typer.Typer:
    """Return the program with all commands, or with only one of them."""
    program = make_app(
        "Laser scans in, floor plans out: 2D lidar SLAM with loop closure.",
        name="cartoloop",
        add_completion=True,
    )
    program.callback()(_options)
    for command in COMMANDS:
        if only in (None, command.name):
            add_command(program, **command._asdict())
    for name, (app, group) in GROUPS.items():
        if only in (None, name):
            program.add_typer(app, name=name, rich_help_panel=group)
    return program


def program_for(arguments: Sequence[str]) -> typer.Typer:
    """Return the program with the command that the first argument names; else with all."""
    names = {*GROUPS, *(command.name for command in COMMANDS)}
    first = arguments[0] if arguments else None
    return make_program(first if first in names else None)


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"cartoloop {__version__}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version."),
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show where an unexpected error happened.")
    ] = False,
) -> None:
    pass
