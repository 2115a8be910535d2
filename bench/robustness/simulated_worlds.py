# SPDX-License-Identifier: Apache-2.0
"""The table of simulated worlds, ``worlds.toml``."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
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
    bar : of the mean error [m], unless it is a share of the path length.
    bar_share : of the path length; 0 where `bar` counts.
    suffix : of the log's name.
    """

    name: str
    options: tuple[str, ...]
    seeds: int
    bar: float
    bar_share: float
    suffix: str

    def bar_of(self, path_length: float) -> float:
        """Return the largest mean error of a map that is right [m]."""
        return self.bar_share * path_length if self.bar_share else self.bar


@cache
def simulated_worlds() -> dict[str, SimulatedWorld]:
    """Return all worlds by name, in the order of the table."""
    table: dict[str, Any] = tomllib.loads(_FILE.read_text("utf-8"))
    return {
        name: SimulatedWorld(
            name=name,
            options=tuple(row.get("options", name).split()),
            seeds=row.get("seeds", table["default_seeds"]),
            bar=row.get("bar", table["default_bar"]),
            bar_share=row.get("bar_share", 0.0),
            suffix=".bag" if row.get("bag", False) else ".log",
        )
        for name, row in table["worlds"].items()
    }
