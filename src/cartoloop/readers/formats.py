# SPDX-License-Identifier: Apache-2.0
"""The formats of recordings: the built-in ones, and those of other installed packages.

A package adds a text format of its own by an entry point of the group ``cartoloop.log_formats``,
which names a `LineFormat` (docs/readers.md). This module imports no reader by itself, so that the
command line can name the formats at once.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

from cartoloop.errors import InputError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from cartoloop.readers.line_format import LineFormat

GROUP = "cartoloop.log_formats"
"""Entry points of this group are text formats."""

_TEXT_FORMATS = {
    "DP-SLAM log": ("dpslam", "DPSLAM"),
    "tinySLAM file": ("tinyslam", "TINYSLAM"),
    "CSV file": ("csv_log", "CSV"),
    "CARMEN log": ("carmen", "CARMEN"),
}
"""Name for the user, module in `cartoloop.readers` and name of the `LineFormat` in it.

In the order of recognition: CARMEN logs last, because one known tag among the first lines is enough
for them.
"""

_ROS_FORMATS = ("ROS 1 bag", "ROS 2 recording (folder, .mcap, .db3)")


def format_names() -> list[str]:
    """Return the names of the built-in formats, for the user."""
    return [*_TEXT_FORMATS, *_ROS_FORMATS]


def installed_format_names() -> list[str]:
    """Return the names of the formats of other packages."""
    return [entry.name for entry in _entry_points()]


def text_formats() -> Iterator[LineFormat]:
    """Yield the text formats in the order of recognition, those of other packages first.

    Raises
    ------
    InputError
        A format of another package cannot be loaded.
    """
    for entry in _entry_points():
        yield _load(entry)
    for module, attribute in _TEXT_FORMATS.values():
        line_format: LineFormat = getattr(import_module(f"cartoloop.readers.{module}"), attribute)
        yield line_format


def _entry_points() -> list[EntryPoint]:
    return _entry_points_on(tuple(sys.path))


@cache
def _entry_points_on(_: tuple[str, ...]) -> list[EntryPoint]:
    """Return those of all packages on a search path; cached, since the files of all are read."""
    from importlib.metadata import entry_points

    return sorted(entry_points(group=GROUP), key=lambda entry: entry.name)


def _load(entry: EntryPoint) -> LineFormat:
    from cartoloop.readers.line_format import LineFormat

    remedy = "repair or uninstall the package that provides it"
    try:
        loaded = entry.load()
    except Exception as error:
        raise InputError(
            f"log format {entry.name!r} ({entry.value}) cannot be loaded: {error}; {remedy}"
        ) from error
    if not isinstance(loaded, LineFormat):
        raise InputError(
            f"log format {entry.name!r} ({entry.value}) is a {type(loaded).__name__}, not a "
            f"LineFormat; {remedy}"
        )
    return loaded
