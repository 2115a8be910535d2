# SPDX-License-Identifier: Apache-2.0
"""Commands whose options are the fields of one dataclass, and the form of their help.

Options and commands stand in the groups that their `rich_help_panel` names; each help ends with
examples, and nothing in it is cut.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from inspect import Signature, signature
from typing import Any, ClassVar, TypeVar, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from cartoloop.errors import Interrupted

Options = TypeVar("Options")


WHOLE = 1000
"""Limit of the sentence that describes a command [characters]: it is never cut."""


class GroupedCommand(TyperCommand):
    """A command whose help lists options under the `rich_help_panel` that they name.

    Attributes
    ----------
    renamed : new names of options by their old ones, which still work, with a warning.
    """

    renamed: ClassVar[Mapping[str, str]] = {}

    def get_short_help_str(self, limit: int = WHOLE) -> str:
        """Return the first sentence of the help: for lists of commands, and for shells."""
        return super().get_short_help_str(max(limit, WHOLE))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - types of click
        """Replace old names of options, then parse."""
        return super().parse_args(ctx, self._with_new_names(args))

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write arguments first, then options without a group, then each group."""
        groups: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is not None:
                is_argument = param.param_type_name == "argument"
                group = getattr(param, "rich_help_panel", None) or "Options"
                if is_argument:  # without its type
                    record = (param.metavar or param.name.upper(), record[1])
                groups.setdefault("Arguments" if is_argument else group, []).append(record)
        _write_groups(formatter, groups)

    def _with_new_names(self, args: list[str]) -> list[str]:
        new, is_option = [], True
        for arg in args:
            is_option = is_option and arg != "--"
            name, equals, value = arg.partition("=")
            if is_option and name in self.renamed:
                typer.echo(f"warning: {name} is now called {self.renamed[name]}", err=True)
                new.append(f"{self.renamed[name]}{equals}{value}")
            else:
                new.append(arg)
        return new


class GroupedGroup(TyperGroup):
    """A group of commands whose help lists them under the `rich_help_panel` that they name."""

    def get_short_help_str(self, limit: int = WHOLE) -> str:
        """Return the first sentence of the help: for lists of commands, and for shells."""
        return super().get_short_help_str(max(limit, WHOLE))

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - types of click
        """Write the first sentence of the help of each command, however long."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            command = self.get_command(ctx, name)
            if command is not None and not command.hidden:
                panel = getattr(command, "rich_help_panel", None)
                group = panel if isinstance(panel, str) else "Commands"
                sentence = command.get_short_help_str(limit=WHOLE)
                groups.setdefault(group, []).append((name, sentence))
        _write_groups(formatter, groups)


def _write_groups(formatter: Any, groups: Mapping[str, Sequence[tuple[str, str]]]) -> None:  # noqa: ANN401
    for group, records in groups.items():
        if records:
            with formatter.section(group):
                formatter.write_dl(records)


def make_app(
    help_text: str,
    *,
    name: str | None = None,
    add_completion: bool = False,
    cls: type[GroupedGroup] = GroupedGroup,
) -> typer.Typer:
    """Return an app of commands, whose help is plain text."""
    return typer.Typer(
        name=name,
        help=help_text,
        cls=cls,
        no_args_is_help=True,
        add_completion=add_completion,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )


def add_command(
    app: typer.Typer,
    name: str,
    command: Callable[[Options], None],
    options: type[Options],
    examples: Sequence[str],
    *,
    group: str | None = None,
    cls: type[GroupedCommand] = GroupedCommand,
) -> None:
    """Add a command to an app.

    Parameters
    ----------
    app : to extend.
    name : of the command.
    command : called with the options; its docstring is the help.
    options : a dataclass whose fields are annotated with `typer.Option` or `typer.Argument`.
    examples : command lines, shown at the end of the help.
    group : under which the help of the app lists it.
    cls : of the command.
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
    add_function(app, name, run, examples, group=group, cls=cls)


def add_function(
    app: typer.Typer,
    name: str,
    function: Callable[..., None],
    examples: Sequence[str],
    *,
    group: str | None = None,
    cls: type[GroupedCommand] = GroupedCommand,
) -> None:
    """Add a command whose parameters are those of a function; see `add_command`."""
    title = "Example:" if len(examples) == 1 else "Examples:"
    lines = "\n".join((title, *(f"  {example}" for example in examples)))
    as_it_stands = "\b\n"  # is not wrapped
    app.command(name, cls=cls, epilog=as_it_stands + lines, rich_help_panel=group)(function)
