# SPDX-License-Identifier: Apache-2.0
"""Figures of other programs, from ``published.toml``."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any, Final

SOURCES: Final = {
    "paper": "Cartographer (paper)",
    "cpp": "Cartographer (C++)",
    "GM": "GM",
    "FLIRT": "Graph FLIRT",
}
"""Sources of figures: the key in the file, and the heading of its column."""


@cache
def published() -> dict[str, Any]:
    """Return the tables of the file; its comments say what each figure is."""
    return tomllib.loads(files("bench.paper").joinpath("published.toml").read_text("utf-8"))
