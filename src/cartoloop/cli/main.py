# SPDX-License-Identifier: Apache-2.0
"""The command ``cartoloop``: its parts, and how errors are reported.

Commands import what they need inside their functions: ``cartoloop --help`` must neither wait for
the compiler nor for SciPy.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from typing import Annotated

import typer

from cartoloop.cli.commands import add_command, make_app
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
from cartoloop.cli.lost_output import forget_lost_output, loss_of_output
from cartoloop.cli.map_command import MapOptions, map_command
from cartoloop.cli.merge_command import MergeOptions, merge_command
from cartoloop.cli.quality_command import QualityOptions, quality_command
from cartoloop.cli.simulate_command import SimulateOptions, simulate_command
from cartoloop.cli.stop_signals import end_orderly
from cartoloop.cli.view_command import ViewCommandOptions, ViewingCommand, view_command
from cartoloop.errors import CartoloopError, ConfigError, Interrupted
from cartoloop.plain_text import one_line
from cartoloop.version import __version__

MAKE, USE, RECORDINGS = "Make a map", "Use a map", "Recordings and parameters"
"""Groups of commands in the help."""

app = make_app(
    "Laser scans in, floor plans out: 2D lidar SLAM with loop closure.",
    name="cartoloop",
    add_completion=True,
)
add_command(
    app,
    "demo",
    demo_command,
    DemoOptions,
    ["cartoloop demo", "cartoloop demo -o office --seed 3"],
    group=MAKE,
)
add_command(
    app,
    "map",
    map_command,
    MapOptions,
    [
        "cartoloop map intel.clf.gz -o intel --view",
        "cartoloop map tuesday.bag --scan-topic /scan --onto monday",
    ],
    group=MAKE,
    cls=ViewingCommand,
)
add_command(
    app,
    "merge",
    merge_command,
    MergeOptions,
    [
        "cartoloop merge monday tuesday -o week",
        "cartoloop merge robot1 robot2 robot3 -o hall --strict",
    ],
    group=MAKE,
)
add_command(
    app,
    "live",
    live_command,
    LiveCommandOptions,
    [
        "cartoloop live tcp://127.0.0.1:7000 -o floor --view",
        "cartoloop live tcp://0.0.0.0:7000 -o floor --source-host 0.0.0.0",
    ],
    group=MAKE,
    cls=LiveCommand,
)
add_command(
    app,
    "view",
    view_command,
    ViewCommandOptions,
    ["cartoloop view intel --edit", "cartoloop view intel --view-host 0.0.0.0"],
    group=USE,
    cls=ViewingCommand,
)
add_command(
    app,
    "locate",
    locate_command,
    LocateOptions,
    [
        "cartoloop locate intel drive.bag --changes changed --view --speed 1",
        "cartoloop locate map.yaml tcp://127.0.0.1:7000 --at 1.5,-2,90 --poses poses.jsonl",
    ],
    group=USE,
)
add_command(
    app,
    "info",
    info_command,
    InfoOptions,
    ["cartoloop info intel", "cartoloop info intel --json"],
    group=USE,
)
add_command(
    app,
    "export",
    export_command,
    ExportOptions,
    [
        "cartoloop export intel -o plan.png --resolution 0.02 --rotate auto --crop auto",
        "cartoloop export intel -o kitchen.png --crop -2,-5,4,1 --draw none",
    ],
    group=USE,
)
add_command(
    app,
    "quality",
    quality_command,
    QualityOptions,
    ["cartoloop quality intel", "cartoloop quality intel --strict"],
    group=USE,
)
add_command(
    app,
    "explain",
    explain_command,
    ExplainOptions,
    ["cartoloop explain intel --pair 3 1200", "cartoloop explain intel --near 4.5 -2"],
    group=USE,
)
app.add_typer(edit_app, name="edit", rich_help_panel=USE)
app.add_typer(evaluate_app, name="evaluate", rich_help_panel=USE)
add_command(
    app,
    "doctor",
    doctor_command,
    DoctorOptions,
    ["cartoloop doctor robot.bag", "cartoloop doctor *.log --json"],
    group=RECORDINGS,
)
add_command(
    app,
    "simulate",
    simulate_command,
    SimulateOptions,
    [
        "cartoloop simulate office -o office.log.gz --truth office.tum",
        "cartoloop simulate museum -o walk.bag --tilt-deg 8 --distort",
    ],
    group=RECORDINGS,
)
app.add_typer(config_app, name="config", rich_help_panel=RECORDINGS)


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"cartoloop {__version__}")
        raise typer.Exit


@app.callback()
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


_FILE_COMMANDS = frozenset(("demo", "map", "merge", "live", "simulate", "view", "edit"))
"""Commands whose result is not what they print."""

_SHOWN = 200
"""Characters of a path that a message shows."""


def run(arguments: Sequence[str], program: typer.Typer = app) -> int:
    """Run a command line, by default that of ``cartoloop``, and return its exit status.

    0: done, 1: failed, 2: wrong usage or configuration, 3: with --strict, the map is not good,
    4: a session found no place in the map, 130: interrupted.
    """
    if program is app and "" in arguments:  # as a path, it would be the working directory
        place = list(arguments).index("")
        after = f", after {arguments[place - 1]}" if place else ""
        typer.echo(
            f"cartoloop: an argument is empty{after}: is a variable of the shell not set?", err=True
        )
        return 2
    debug = "--debug" in arguments  # at any position
    name = program.info.name if isinstance(program.info.name, str) else None
    try:
        program(
            args=[argument for argument in arguments if argument != "--debug"],
            prog_name=name,  # not __main__.py: completion is installed for this name
        )
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except Interrupted as interruption:
        typer.echo(f"cartoloop: {interruption}", err=True)
        return 130
    except CartoloopError as error:
        typer.echo(f"cartoloop: {error}", err=True)
        return 2 if isinstance(error, ConfigError) else 1
    except Exception as error:  # noqa: BLE001 - users get a line, not a traceback
        if debug:
            traceback.print_exc()
        typer.echo(f"cartoloop: {_unexpected(error)}", err=True)
        return 1
    return 0


def _unexpected(error: Exception) -> str:
    """Return the line about an error that no command expects."""
    said = " ".join(str(error).split())
    if isinstance(error, OSError) and error.filename is not None:
        # A path that the system refuses, such as one that is too long.
        shown = one_line(os.fsdecode(error.filename))[:_SHOWN]
        return f"{shown}: {error.strerror}; check the path"
    if isinstance(error, MemoryError):
        reason = f" ({said})" if said else ""
        return (
            f"there is not enough memory{reason}; end other programs, or take a larger "
            "local_slam.submaps.resolution or export --resolution"
        )
    return (
        f"unexpected {type(error).__name__}: {said}; this is a bug, please report it with the "
        "output of the same command and --debug"
    )


def main() -> None:
    """Run the command line of this process."""
    forget_lost_output()
    end_orderly()
    status = run(sys.argv[1:])
    sys.stdout.flush()
    loss = loss_of_output()
    if status == 0 and loss is not None and not _FILE_COMMANDS.intersection(sys.argv[1:3]):
        typer.echo(f"cartoloop: standard output: cannot be written: {loss.strerror}", err=True)
        status = 1
    sys.exit(status)
