# SPDX-License-Identifier: Apache-2.0
"""Recordings in, one stream of typed, time-stamped sensor events out."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cartoloop.readers.line_format import LineError as LineError
    from cartoloop.readers.line_format import LineFormat as LineFormat
    from cartoloop.readers.line_format import Reading as Reading
    from cartoloop.readers.line_log import LineLog as LineLog
    from cartoloop.readers.log import Log as Log
    from cartoloop.readers.log import LogPass as LogPass
    from cartoloop.readers.log import LogProblem as LogProblem
    from cartoloop.readers.read_options import ReadOptions as ReadOptions
    from cartoloop.readers.recognition import open_log as open_log
    from cartoloop.readers.recognition import open_logs as open_logs
    from cartoloop.readers.recognition import read as read

_HOME = {
    "LineError": "line_format",
    "LineFormat": "line_format",
    "LineLog": "line_log",
    "Log": "log",
    "LogPass": "log",
    "LogProblem": "log",
    "ReadOptions": "read_options",
    "Reading": "line_format",
    "open_log": "recognition",
    "open_logs": "recognition",
    "read": "recognition",
}


def __getattr__(name: str) -> object:
    """Import a public name when it is first used: the command line needs only format names."""
    if name not in _HOME:
        raise AttributeError(f"module 'cartoloop.readers' has no attribute {name!r}")
    return getattr(import_module(f"cartoloop.readers.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
