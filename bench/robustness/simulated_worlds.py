# SPDX-License-Identifier: Apache-2.0
"""The table of simulated worlds, ``worlds.toml``."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

_FILE = Path(__file__).with_name("worlds.toml")


@dataclass(frozen=True, slots=True)
class SimulatedWorld:
    """A world to map, with as many seeds as wanted.

    Attributes
    ----------
    name : of the row.
    options : arguments of ``cartoloop simulate``.
    seeds : how many seeds are tried.
    bar : of the mean error [m]; infinite where none is asked for.
    settings : parameters of the mapper that are not the defaults, as ``key=value``.
    suffix : of the log's name.
    """

    name: str
    options: tuple[str, ...]
    seeds: int
    bar: float
    suffix: str
    settings: tuple[str, ...] = ()


@cache
def _table() -> dict[str, Any]:
    return tomllib.loads(_FILE.read_text("utf-8"))


@cache
def simulated_worlds() -> dict[str, SimulatedWorld]:
    """Return all worlds by name, in the order of the table."""
    table = _table()
    return {
        name: SimulatedWorld(
            name=name,
            options=tuple(row.get("options", name).split()),
            seeds=row.get("seeds", table["default_seeds"]),
            bar=row.get("bar", table["default_bar"]),
            suffix=".bag" if row.get("bag", False) else ".log",
        )
        for name, row in table["worlds"].items()
    }


@cache
def handicapped_worlds() -> dict[str, SimulatedWorld]:
    """Return worlds that are mapped with a handicap, by name; they may be wrong."""
    table = _table()["handicapped"]
    worlds = simulated_worlds()
    return {
        f"{name}, {handicap}": replace(
            worlds[name],
            name=f"{name}, {handicap}",
            seeds=table["seeds"],
            bar=math.inf,
            settings=tuple(settings),
        )
        for handicap, settings in table["settings"].items()
        for name in table["worlds"]
    }
