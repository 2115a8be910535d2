# SPDX-License-Identifier: Apache-2.0
"""Recordings in, one stream of typed, time-stamped sensor events out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from cartoloop.readers.carmen import CarmenLog
from cartoloop.readers.chain import LogChain
from cartoloop.readers.log import Log, Problem
from cartoloop.sensor.events import SensorEvent

__all__ = ["Log", "Problem", "open_log", "open_logs", "read"]


def read(path: str | Path) -> Iterator[SensorEvent]:
    """Yield the sensor events of a recording in the order they happened.

    Parameters
    ----------
    path : a CARMEN log, plain or gzip.

    Raises
    ------
    InputError
        At once if the recording cannot be used; see `open_log`.
    """
    return iter(open_log(path))


def open_log(path: str | Path) -> Log:
    """Return a recording, ready to iterate, with its sensor profile and what is wrong with it.

    Parameters
    ----------
    path : a CARMEN log, plain or gzip.

    Raises
    ------
    InputError
        If the file cannot be read, is no recording, or holds no usable scan. Faults of single
        lines are no error: they are counted in `Log.skipped` and told in `Log.problems`.
    """
    return CarmenLog(path)


def open_logs(paths: Sequence[str | Path]) -> Log:
    """Return several recordings as one, in the order given.

    Raises
    ------
    InputError
        As `open_log`, for any of them.
    ValueError
        If there are no paths.
    """
    logs = [open_log(path) for path in paths]
    return logs[0] if len(logs) == 1 else LogChain(logs)
