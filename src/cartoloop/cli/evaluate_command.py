# SPDX-License-Identifier: Apache-2.0
"""``cartoloop evaluate``: how good a result is, one subcommand a file ``evaluate_<name>.py``."""

from __future__ import annotations

from cartoloop.cli.commands import add_function, make_app
from cartoloop.cli.evaluate_closures import closures_command
from cartoloop.cli.evaluate_lines import lines_command
from cartoloop.cli.evaluate_relations import relations_command
from cartoloop.cli.evaluate_trajectory import trajectory_command
from cartoloop.cli.make_relations_command import make_relations_command

evaluate_app = make_app("Measure how good a result is.")


@evaluate_app.callback()
def _evaluate() -> None:
    # Keeps each subcommand a subcommand, were it the only one.
    pass


add_function(
    evaluate_app,
    "relations",
    relations_command,
    [
        "cartoloop evaluate relations intel/trajectory.tum intel.relations",
        "cartoloop evaluate relations intel/trajectory.tum intel.relations "
        "--before intel/local_trajectory.tum",
    ],
)
add_function(
    evaluate_app,
    "trajectory",
    trajectory_command,
    ["cartoloop evaluate trajectory office/trajectory.tum office.tum --plot errors.png"],
)
add_function(
    evaluate_app,
    "closures",
    closures_command,
    [
        "cartoloop evaluate closures intel",
        "cartoloop evaluate closures office --truth office.tum --log office.log.gz",
    ],
)
add_function(
    evaluate_app,
    "make-relations",
    make_relations_command,
    ["cartoloop evaluate make-relations intel -o my.relations"],
)
add_function(
    evaluate_app,
    "lines",
    lines_command,
    ["cartoloop evaluate lines intel my.lines --plot lines.png"],
)
