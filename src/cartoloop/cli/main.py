# SPDX-License-Identifier: Apache-2.0
"""The command ``cartoloop``, and how errors are reported.

Commands import what they need inside their functions: ``cartoloop --help`` must neither wait for
the compiler nor for SciPy.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence

import typer

from cartoloop.cli.lost_output import forget_lost_output, loss_of_output
from cartoloop.cli.program import program_for
from cartoloop.cli.stop_signals import end_orderly
from cartoloop.errors import CartoloopError, ConfigError, Interrupted
from cartoloop.plain_text import one_line

_FILE_COMMANDS = frozenset(("demo", "map", "merge", "live", "simulate", "view", "edit"))
"""Commands whose result is not what they print."""

_SHOWN = 200
"""Characters of a path that a message shows."""


def run(arguments: Sequence[str], program: typer.Typer | None = None) -> int:
    """Run a command line, by default that of ``cartoloop``, and return its exit status.

    0: done, 1: failed, 2: wrong usage or configuration, 3: with --strict, the map is not good,
    4: a session found no place in the map, 130: interrupted.
    """
    if program is None and "" in arguments:  # as a path, it would be the working directory
        place = list(arguments).index("")
        after = f", after {arguments[place - 1]}" if place else ""
        typer.echo(
            f"cartoloop: an argument is empty{after}: is a variable of the shell not set?", err=True
        )
        return 2
    debug = "--debug" in arguments  # at any position
    args = [argument for argument in arguments if argument != "--debug"]
    program = program or program_for(args)
    name = program.info.name if isinstance(program.info.name, str) else None
    try:
        program(
            args=args,
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
