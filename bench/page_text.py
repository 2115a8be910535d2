# SPDX-License-Identifier: Apache-2.0
"""The prose of the results page, from ``page_text.toml``."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any, Final

_FILE: Final = Path(__file__).with_name("page_text.toml")


@cache
def page_text() -> dict[str, Any]:
    """Return the tables of the file: titles and texts by section."""
    return tomllib.loads(_FILE.read_text("utf-8"))
