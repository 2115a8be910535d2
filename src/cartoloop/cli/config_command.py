# SPDX-License-Identifier: Apache-2.0
"""``cartoloop config``: the effective configuration, with the origin of each value."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cartoloop.cli.commands import add_function, make_app
from cartoloop.cli.options import ConfigOption, SetOption

config_app = make_app("Show or check the configuration.")


def show(settings: SetOption = None, config: ConfigOption = None) -> None:
    """Print all parameters as TOML: value, meaning, unit and origin."""
    from cartoloop.config_file import config_toml, load_config

    loaded = load_config(config, settings or [])
    typer.echo(config_toml(loaded.config, loaded.origins), nl=False)


def check(file: Annotated[Path, typer.Argument(metavar="FILE", help="TOML file.")]) -> None:
    """Check a configuration file: unknown keys, types, ranges."""
    from cartoloop.config_file import load_config

    loaded = load_config(file)
    typer.echo(f"{file}: good; it gives {len(loaded.origins)} parameters")


add_function(
    config_app,
    "show",
    show,
    ["cartoloop config show", "cartoloop config show --set local_slam.submaps.resolution=0.1"],
)
add_function(config_app, "check", check, ["cartoloop config check my.toml"])
