# SPDX-License-Identifier: Apache-2.0
"""A recording while it is being written: a CARMEN log, or a file of messages."""

from __future__ import annotations

import os
from pathlib import Path
from threading import Event
from typing import BinaryIO

from cartoloop.errors import InputError
from cartoloop.live.carmen_messages import CarmenStream
from cartoloop.live.messages import LiveMessage
from cartoloop.live.notices import Notices
from cartoloop.live.source import LineReceiver, Put, parse_json_line
from cartoloop.readers.log import short_name
from cartoloop.readers.ros.opening import is_recording

PERIOD_S = 0.02
"""Period at which the file is checked for more [s]."""

_CHUNK = 2**18


class GrowingFile:
    """The contents of a file and all that is appended to it; it may be started again.

    Parameters
    ----------
    path : the file; each line is a message in JSON or a line of a CARMEN log.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.name = short_name(path)
        self._carmen = CarmenStream()

    def open(self) -> str:
        """Check that the file can be read."""
        try:
            if self._path.exists() and not self._path.is_file():
                raise InputError(
                    f"{self._path}: is a folder, a pipe or a device and cannot be followed; of a "
                    f"pipe, give its messages: cartoloop live - < {self._path}"
                )
            if is_recording(self._path):
                raise InputError(
                    f"{self._path}: is a ROS recording and cannot be followed; use 'cartoloop map' "
                    "when it is complete, or follow the topics with ros2:"
                )
            with self._path.open("rb") as file:
                if file.read(2) == b"\x1f\x8b":
                    raise InputError(
                        f"{self._path}: is compressed and cannot be followed; use 'cartoloop "
                        "map' when it is complete"
                    )
        except OSError as error:
            raise InputError(
                f"{self._path}: cannot be read: {error.strerror}; give a CARMEN log that is being "
                "written, -, tcp://127.0.0.1:PORT, ws://127.0.0.1:PORT or ros2:"
            ) from error
        return f"following {self._path}"

    def run(self, put: Put, notices: Notices, stop: Event) -> None:
        """Pass on the messages in the file, and those appended later."""
        lines = LineReceiver(put, notices, self.name, self.parse)
        file: BinaryIO | None = None
        position = 0
        while not stop.is_set():
            try:
                file = file or self._path.open("rb")
                if data := file.read(_CHUNK):
                    position += len(data)
                    lines.feed(data)
                    continue
                if self._is_restarted(file, position):
                    notices.note("file restarted", f"{self.name}: the file was started again")
                    lines.reset()
                    file.close()
                    file, position = None, 0
                    continue
            except OSError as error:
                notices.note("file unreadable", f"{self.name}: {error.strerror}; it is tried again")
            stop.wait(PERIOD_S)
        if file is not None:
            file.close()

    def _is_restarted(self, file: BinaryIO, position: int) -> bool:
        """Return whether the file was replaced or truncated."""
        try:
            now = self._path.stat()
        except FileNotFoundError:
            return False
        return now.st_ino != os.fstat(file.fileno()).st_ino or now.st_size < position

    def parse(self, line: bytes) -> list[LiveMessage]:
        """Return the messages in a line: JSON, or of a CARMEN log.

        Raises
        ------
        MessageError
            It cannot be used.
        """
        if line.lstrip().startswith(b"{"):
            return list(parse_json_line(line))
        return self._carmen.parse(line)
