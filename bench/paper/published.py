# SPDX-License-Identifier: Apache-2.0
"""The figures of others that ours are shown beside, from ``published.toml``."""

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
"""Who a figure is of: the key in the file, and the head of its column."""


@cache
def published() -> dict[str, Any]:
    """Return the tables of the file; its comments say what each figure is."""
    return tomllib.loads(files("bench.paper").joinpath("published.toml").read_text("utf-8"))
