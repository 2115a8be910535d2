# SPDX-License-Identifier: Apache-2.0
"""The command ``cartoloop``: its parts, and how errors are told.

Commands import what they need inside their functions: ``cartoloop --help`` must neither wait for
the compiler nor for SciPy.
"""

from __future__ import annotations

import io
import sys
import traceback
from collections.abc import Sequence
from typing import Annotated

import typer

import cartoloop
from cartoloop.cli.config_command import config_app
from cartoloop.cli.demo_command import demo_command
from cartoloop.cli.doctor_command import doctor_command
from cartoloop.cli.evaluate_command import evaluate_app
from cartoloop.cli.explain_command import explain_command
from cartoloop.cli.live_command import live_command
from cartoloop.cli.map_command import map_command
from cartoloop.cli.simulate_command import simulate_command
from cartoloop.cli.view_command import view_command
from cartoloop.errors import CartoloopError, ConfigError, Interrupted

app = typer.Typer(
    name="cartoloop",
    help="Laser scans in, floor plans out: 2D lidar SLAM with loop closure.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("demo")(demo_command)
app.command("map")(map_command)
app.command("live")(live_command)
app.command("doctor")(doctor_command)
app.command("simulate")(simulate_command)
app.command("view")(view_command)
app.command("explain")(explain_command)
app.add_typer(evaluate_app, name="evaluate")
app.add_typer(config_app, name="config")


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"cartoloop {cartoloop.__version__}")
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


def run(arguments: Sequence[str], program: typer.Typer = app) -> int:
    """Run a command line, by default that of ``cartoloop``, and return its exit status.

    0: done, 1: failed, 2: wrong usage or configuration, 130: interrupted.
    """
    debug = "--debug" in arguments  # wherever it stands
    try:
        program(args=[argument for argument in arguments if argument != "--debug"])
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
        typer.echo(
            f"cartoloop: unexpected {type(error).__name__}: {' '.join(str(error).split())}; this "
            "is a bug, please report it with the output of the same command and --debug",
            err=True,
        )
        return 1
    return 0


def main() -> None:
    """Run the command line of this process."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")  # any path can be told on any terminal
    sys.exit(run(sys.argv[1:]))
