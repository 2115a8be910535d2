# SPDX-License-Identifier: Apache-2.0
"""The form of ``cartoloop edit OUT COMMAND``: the folder stands before the command."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any

import typer

from cartoloop.cli.commands import GroupedCommand, GroupedGroup

OutArgument = Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a finished map.")]

DryRunOption = Annotated[
    bool, typer.Option("--dry-run", help="Print what would change, and change nothing.")
]

LIST = "list"
"""The command that is meant where none is given."""


class EditGroup(GroupedGroup):
    """Commands whose first argument stands before their name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - types of click
        """Put the command first, then parse."""
        asked = with_command_first(args, self.commands, is_completion=ctx.resilient_parsing)
        return super().parse_args(ctx, asked)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ANN401
        """Return the words of the line of usage."""
        return ["OUT", *super().collect_usage_pieces(ctx)]


class EditCommand(GroupedCommand):
    """A command of the group."""

    def format_usage(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write the line of usage as the command is to be used."""
        group, _, name = ctx.command_path.rpartition(" ")
        pieces = [piece for piece in self.collect_usage_pieces(ctx) if piece.strip("{}") != "OUT"]
        formatter.write_usage(f"{group} OUT {name}", " ".join(pieces))


def with_command_first(
    args: list[str], commands: Collection[str], *, is_completion: bool = False
) -> list[str]:
    """Return arguments with the name of the command before the folder; ``list`` where none is.

    Parameters
    ----------
    args : what follows ``cartoloop edit``.
    commands : names.
    is_completion : whether a shell asks what may follow: a folder alone is left out then.
    """
    if not args or args[0].startswith("-"):
        return args
    if len(args) == 1:
        if args[0] in commands:
            return args
        return [] if is_completion else [LIST, args[0]]
    is_command_first = args[0] in commands and args[1] not in commands
    if is_command_first or (args[1].startswith("-") and args[0] in commands):
        return args
    if args[1].startswith("-"):
        return [LIST, *args]
    return [args[1], args[0], *args[2:]]
