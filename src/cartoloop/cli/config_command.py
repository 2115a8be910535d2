# SPDX-License-Identifier: Apache-2.0
"""``cartoloop config``: the effective configuration, with the origin of each value."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cartoloop.cli.options import ConfigOption, SetOption

config_app = typer.Typer(
    help="Show or check the configuration.", no_args_is_help=True, rich_markup_mode=None
)


@config_app.command("show")
def show(settings: SetOption = None, config: ConfigOption = None) -> None:
    """Print all parameters as TOML: value, meaning, unit and origin."""
    from cartoloop.config_file import config_toml, load_config

    loaded = load_config(config, settings or [])
    typer.echo(config_toml(loaded.config, loaded.origins), nl=False)


@config_app.command("check")
def check(file: Annotated[Path, typer.Argument(metavar="FILE", help="TOML file.")]) -> None:
    """Check a configuration file: unknown keys, types, ranges."""
    from cartoloop.config_file import load_config

    loaded = load_config(file)
    typer.echo(f"{file}: good; it gives {len(loaded.origins)} parameters")
