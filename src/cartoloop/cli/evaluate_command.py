# SPDX-License-Identifier: Apache-2.0
"""``cartoloop evaluate``: how good a result is, one subcommand a file ``evaluate_<name>.py``."""

from __future__ import annotations

import typer

from cartoloop.cli.evaluate_closures import closures_command
from cartoloop.cli.evaluate_lines import lines_command
from cartoloop.cli.evaluate_relations import relations_command
from cartoloop.cli.evaluate_trajectory import trajectory_command
from cartoloop.cli.make_relations_command import make_relations_command

evaluate_app = typer.Typer(help="Evaluate a result.", no_args_is_help=True, rich_markup_mode=None)


@evaluate_app.callback()
def _evaluate() -> None:
    # Keeps each subcommand a subcommand, were it the only one.
    pass


evaluate_app.command("relations")(relations_command)
evaluate_app.command("trajectory")(trajectory_command)
evaluate_app.command("closures")(closures_command)
evaluate_app.command("make-relations")(make_relations_command)
evaluate_app.command("lines")(lines_command)
