# SPDX-License-Identifier: Apache-2.0
"""From a path to the recording in it: its format is recognised by its content."""

from __future__ import annotations

import os
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from cartoloop.arguments import as_path, require_type
from cartoloop.errors import InputError
from cartoloop.readers.chain import LogChain
from cartoloop.readers.formats import format_names, installed_format_names, text_formats
from cartoloop.readers.line_log import LineLog, head_of
from cartoloop.readers.log import Log, LogPass
from cartoloop.readers.read_options import ReadOptions
from cartoloop.readers.ros.opening import is_recording
from cartoloop.readers.spool import regular_file
from cartoloop.readers.text_file import TextFile

MAP_FILES = ("map.cartoloop", "journal.cartoloop")
"""Files that are, or mark, a map and no recording."""


def read(path: str | PathLike[str], options: ReadOptions | None = None) -> LogPass:
    """Return the sensor events of a recording in the order they happened, to iterate over once.

    Parameters
    ----------
    path : any recording that `open_log` opens.
    options : what is known better than the recording states it.

    Raises
    ------
    InputError
        At once if the recording cannot be used; see `open_log`.
    """
    return iter(open_log(path, options))


def open_log(path: str | PathLike[str], options: ReadOptions | None = None) -> Log:
    """Return a recording, ready to iterate, with its scanner's profile and its problems.

    Parameters
    ----------
    path : a recording in one of the formats in docs/readers.md, or of an installed package, text
        plain or gzip. The format is recognised by the content. What comes through a pipe is copied
        first; ``-`` is standard input.
    options : what is known better than the recording states it.

    Raises
    ------
    InputError
        If the file cannot be read, is no recording, or holds no usable scan. Faults of single
        lines or messages raise nothing: they are counted in `Log.skipped` and described in
        `Log.problems`.
    """
    path = as_path(path, "recording")
    if options is not None:
        require_type(options, ReadOptions, "options", "a cartoloop.readers.ReadOptions")
    options = options or ReadOptions()
    path = regular_file(path)
    _require_no_map(path)
    if is_recording(path):
        from cartoloop.readers.ros.bag import BagLog

        return BagLog(path, options)
    if options.bag_only:
        raise InputError(
            f"{path}: is no ROS recording, so {options.bag_only[0]} means nothing here; "
            "leave it out"
        )
    text = TextFile(path)
    head = head_of(text)
    for line_format in text_formats():
        if line_format.recognise(head):
            return LineLog(text, line_format, laser_pose=options.laser_pose)
    known = ", ".join([*format_names(), *installed_format_names()])
    raise InputError(f"{path}: is not in a known format; give one of: {known}")


def _require_no_map(path: Path) -> None:
    """Check that a path is not that of a map, which is given in place of a recording at times."""
    if path.name in MAP_FILES or any((path / name).is_file() for name in MAP_FILES):
        raise InputError(
            f"{path}: is a map, not a recording; `cartoloop merge` joins maps, `cartoloop map "
            "RECORDING --onto MAP` adds to one, `cartoloop locate MAP RECORDING` localises in one"
        )


def open_logs(paths: Sequence[str | PathLike[str]], options: ReadOptions | None = None) -> Log:
    """Return several recordings as one, in the order given.

    Raises
    ------
    InputError
        As `open_log`, for any of them, or one is given twice.
    ValueError
        If there are no paths.
    """
    given = [os.path.realpath(as_path(path, "recording")) for path in paths]
    for place, path in enumerate(paths):
        if given[place] in given[:place]:
            raise InputError(f"{path}: is given twice; give each part of a recording once")
    logs = [open_log(path, options) for path in paths]
    return logs[0] if len(logs) == 1 else LogChain(logs)
