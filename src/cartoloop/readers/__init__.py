# SPDX-License-Identifier: Apache-2.0
"""Recordings in, one stream of typed, time-stamped sensor events out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from cartoloop.errors import InputError
from cartoloop.readers.carmen import CarmenLog
from cartoloop.readers.chain import LogChain
from cartoloop.readers.line_log import LineError, LineFormat, LineLog, Reading, head_of
from cartoloop.readers.log import Log, Problem
from cartoloop.readers.options import ReadOptions
from cartoloop.readers.source import Source
from cartoloop.sensor.events import SensorEvent

__all__ = [
    "LineError",
    "LineFormat",
    "LineLog",
    "Log",
    "Problem",
    "ReadOptions",
    "Reading",
    "open_log",
    "open_logs",
    "read",
]


def read(path: str | Path, options: ReadOptions | None = None) -> Iterator[SensorEvent]:
    """Yield the sensor events of a recording in the order they happened.

    Parameters
    ----------
    path : any recording that `open_log` opens.
    options : what you know better than the recording.

    Raises
    ------
    InputError
        At once if the recording cannot be used; see `open_log`.
    """
    return iter(open_log(path, options))


def open_log(path: str | Path, options: ReadOptions | None = None) -> Log:
    """Return a recording, ready to iterate, with its sensor profile and what is wrong with it.

    Parameters
    ----------
    path : a CARMEN, DP-SLAM, tinySLAM or CSV text log, plain or gzip; a ROS 1 bag; a ROS 2
        recording: its folder, .db3 or .mcap file. What it is, is found out from its content.
    options : what you know better than the recording.

    Raises
    ------
    InputError
        If the file cannot be read, is no recording, or holds no usable scan. Faults of single
        lines or messages are no error: they are counted in `Log.skipped` and told in
        `Log.problems`.
    """
    from cartoloop.readers.ros.opening import is_recording

    options = options or ReadOptions()
    if is_recording(Path(path)):
        from cartoloop.readers.ros.bag import BagLog

        return BagLog(path, options)
    if options.bag_only:
        raise InputError(
            f"{path}: is no ROS recording, so {options.bag_only[0]} means nothing here; "
            "leave it out"
        )
    return _open_text(Source(path), options)


def _open_text(source: Source, options: ReadOptions) -> Log:
    """Return a text recording by its first lines."""
    from cartoloop.readers.csv_log import CSV
    from cartoloop.readers.dpslam import DPSLAM
    from cartoloop.readers.tinyslam import TINYSLAM

    head = head_of(source)
    for line_format in (DPSLAM, TINYSLAM, CSV):
        if line_format.recognise(head):
            return LineLog(source, line_format, laser_pose=options.laser_pose)
    return CarmenLog(source, laser_pose=options.laser_pose)


def open_logs(paths: Sequence[str | Path], options: ReadOptions | None = None) -> Log:
    """Return several recordings as one, in the order given.

    Raises
    ------
    InputError
        As `open_log`, for any of them.
    ValueError
        If there are no paths.
    """
    logs = [open_log(path, options) for path in paths]
    return logs[0] if len(logs) == 1 else LogChain(logs)
