# SPDX-License-Identifier: Apache-2.0
"""Writes poses to a file or a pipe in a background thread, one line of JSON per scan."""

from __future__ import annotations

import errno
import json
import os
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from threading import Condition, Thread
from typing import Any, BinaryIO

from cartoloop.live.notices import Notices
from cartoloop.sensor.pose import Pose

MAX_WAITING = 1000
"""Poses that may wait for a slow reader: those of 20 s at 50 Hz."""


READER_S = 5.0
"""Time for someone to open a pipe for reading [s]: it may be started after this program."""

_POLL_S = 0.05


def open_poses(path: Path, wait: float | None = None) -> BinaryIO:
    """Return a file opened for poses, unbuffered: a line that is lost is not written later.

    Parameters
    ----------
    path : of a file, which is replaced, or of a pipe that somebody reads.
    wait : time for the reader of a pipe to open it [s]; `READER_S` by default.

    Raises
    ------
    OSError
        It cannot be opened; `BrokenPipeError`: nobody reads the pipe.
    """
    deadline = time.monotonic() + (READER_S if wait is None else wait)
    while True:
        try:
            return open(path, "wb", buffering=0, opener=_open_without_waiting)
        except OSError as error:
            if error.errno != errno.ENXIO or not path.is_fifo():
                raise
            if time.monotonic() >= deadline:
                raise BrokenPipeError(
                    errno.EPIPE, "nobody reads this pipe; start its reader first"
                ) from error
        time.sleep(_POLL_S)


def _open_without_waiting(name: str, flags: int) -> int:
    """Open a file; fail where a pipe has no reader instead of waiting for it, perhaps for ever."""
    descriptor = os.open(name, flags | getattr(os, "O_NONBLOCK", 0), 0o666)
    if hasattr(os, "set_blocking"):
        os.set_blocking(descriptor, True)
    return descriptor


class PoseWriter:
    """Writes poses; where the reader is too slow, the oldest are dropped and counted.

    Parameters
    ----------
    out : the stream; flushed after each line.
    notices : receives a line for dropped poses, and for a reader that left.
    """

    def __init__(self, out: BinaryIO, notices: Notices) -> None:
        self._out = out
        self._notices = notices
        self._lines: deque[bytes | None] = deque()
        self._changed = Condition()
        self._thread = Thread(target=self._run, name="poses", daemon=True)
        self._thread.start()

    def put(
        self, stamp: float, tf_local_tracking: Pose, tf_map_tracking: Pose, latency: float
    ) -> None:
        """Queue the pose of a scan for writing; returns at once.

        Parameters
        ----------
        stamp : of the scan [s].
        tf_local_tracking : before loop closure: continuous, drifts.
        tf_map_tracking : in the present map: globally consistent, jumps when loops close.
        latency : from the arrival of the scan to this moment [s].
        """
        self.put_content(
            {
                "type": "pose",
                "stamp": stamp,
                "local": [round(value, 6) for value in tf_local_tracking],
                "map": [round(value, 6) for value in tf_map_tracking],
                "latency_ms": round(1e3 * latency, 3),
            }
        )

    def put_content(self, content: Mapping[str, Any]) -> None:
        """Queue a line of JSON for writing; returns at once."""
        with self._changed:
            if len(self._lines) >= MAX_WAITING:
                self._lines.popleft()
                self._notices.note("poses dropped: their reader is too slow")
            self._lines.append(json.dumps(content).encode() + b"\n")
            self._changed.notify()

    def close(self, timeout: float = 2.0) -> None:
        """Write the waiting poses, for at most `timeout` seconds."""
        with self._changed:
            self._lines.append(None)
            self._changed.notify()
        self._thread.join(timeout)

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._lines:
                    self._changed.wait()
                line = self._lines.popleft()
            if line is None:
                return
            try:
                self._out.write(line)
                self._out.flush()
            except (BrokenPipeError, ValueError) as error:
                self._notices.note(
                    "the reader of the poses left", f"the reader of the poses left: {error}"
                )
                return
            except OSError as error:  # as a full disk, which may have room again
                self._notices.note(
                    "poses lost: they cannot be written",
                    f"poses lost: they cannot be written: {error.strerror}",
                )
