# SPDX-License-Identifier: Apache-2.0
"""Messages that a recording holds twice, as of two recorders or of parts that overlap."""

from __future__ import annotations

from collections import deque

from cartoloop.readers.ros.wire import DecodeError, read_header

NUM_RECENT = 4
"""Messages of a topic among which a copy is looked for."""


class CopyFinder:
    """Finds the copies among the messages of a topic.

    Parameters
    ----------
    is_ros1 : the encoding of the messages.
    """

    def __init__(self, is_ros1: bool) -> None:
        self._is_ros1 = is_ros1
        self._recent: deque[bytes] = deque(maxlen=NUM_RECENT)

    def is_copy(self, raw: bytes) -> bool:
        """Return whether a message equals a recent one in its stamp and all else."""
        if raw in self._recent and self._has_stamp(raw):
            return True
        self._recent.append(raw)
        return False

    def _has_stamp(self, raw: bytes) -> bool:
        # Without a stamp, a robot that stands may send equal messages.
        try:
            return read_header(raw, self._is_ros1).stamp > 0
        except DecodeError:
            return False
