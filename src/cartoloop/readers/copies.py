# SPDX-License-Identifier: Apache-2.0
"""What a recording holds twice, as of a recorder that ran twice or of parts that overlap."""

from __future__ import annotations

from collections import deque

COPIED_SCAN = "exact copy of a scan before"
"""Reason for skipping a scan that is held twice."""

NUM_RECENT = 8
"""Lines, or messages of a topic, among which a copy is looked for."""


class CopyFinder:
    """Finds the copies among lines, or among the messages of a topic.

    Only of contents with a stamp: a robot that stands may send equal ones without.
    """

    def __init__(self) -> None:
        self._recent: deque[bytes] = deque(maxlen=NUM_RECENT)

    def is_copy(self, content: bytes) -> bool:
        """Return whether a content equals a recent one."""
        if content in self._recent:
            return True
        self._recent.append(content)
        return False
