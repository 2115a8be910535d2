# SPDX-License-Identifier: Apache-2.0
"""Commands whose options are the fields of one dataclass, in groups in the help."""

from __future__ import annotations

from collections.abc import Callable
from inspect import Signature, signature
from typing import Any, TypeVar, get_type_hints

import typer
from typer.core import TyperCommand

from cartoloop.errors import Interrupted

Options = TypeVar("Options")


class GroupedCommand(TyperCommand):
    """A command whose help lists options under the `rich_help_panel` that they name."""

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - types of click
        """Write arguments first, then options without a group, then each group."""
        groups: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is not None:
                is_argument = param.param_type_name == "argument"
                group = getattr(param, "rich_help_panel", None) or "Options"
                groups.setdefault("Arguments" if is_argument else group, []).append(record)
        for group, records in groups.items():
            if records:
                with formatter.section(group):
                    formatter.write_dl(records)


def add_command(
    app: typer.Typer,
    name: str,
    command: Callable[[Options], None],
    options: type[Options],
    example: str,
) -> None:
    """Add a command to an app.

    Parameters
    ----------
    app : to extend.
    name : of the command.
    command : called with the options; its docstring is the help.
    options : a dataclass whose fields are annotated with `typer.Option` or `typer.Argument`.
    example : a command line, shown at the end of the help.
    """

    def run(**values: Any) -> None:  # noqa: ANN401 - any option
        try:
            command(options(**values))
        except KeyboardInterrupt as interrupt:
            raise Interrupted("stopped") from interrupt

    hints = get_type_hints(options, include_extras=True)
    own = options.__annotations__  # those of base classes follow
    parameters = sorted(signature(options).parameters.values(), key=lambda p: p.name not in own)
    run.__signature__ = Signature(  # type: ignore[attr-defined]
        [parameter.replace(annotation=hints[parameter.name]) for parameter in parameters]
    )
    run.__doc__ = command.__doc__
    app.command(name, cls=GroupedCommand, epilog=f"Example: {example}")(run)
