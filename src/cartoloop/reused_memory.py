# SPDX-License-Identifier: Apache-2.0
"""Memory for large arrays that come and go: what one gives back, the next one takes.

What the system hands out it clears first, page by page as it is touched, which takes longer than
most of what is then computed in it. What the C library keeps of such blocks seldom fits the next
one, and is not bounded.
"""

from __future__ import annotations

import weakref
from collections import deque
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

ByteArray = NDArray[np.uint8]

MAX_WASTE = 2
"""An array may lie in a block so many times its size; in a larger one it would hide memory."""


_ALL: weakref.WeakSet[ReusedMemory] = weakref.WeakSet()


def return_idle() -> None:
    """Give back to the system what waits for the next array."""
    for memory in list(_ALL):
        memory.drop()


class ReusedMemory:
    """Hands out arrays of bytes; safe to use from several threads at once.

    Parameters
    ----------
    max_idle_bytes : no more than this waits for the next array; what waits for longest goes back to
        the system.
    """

    def __init__(self, max_idle_bytes: int) -> None:
        self._max_idle_bytes = max_idle_bytes
        self._idle: deque[ByteArray] = deque()
        _ALL.add(self)

    @property
    def idle_bytes(self) -> int:
        """How much waits for the next array."""
        return sum(block.nbytes for block in list(self._idle))

    def array(self, size: int) -> ByteArray:
        """Return uint8, shape (size,), holding anything.

        Its memory goes to another one once nobody has it any more, nor a view of it.
        """
        block = self._take(size)
        if block is None:
            block = np.empty(size, dtype=np.uint8)
        # Views of an array made from a buffer keep that array alive, not only its memory.
        handed_out: ByteArray = np.frombuffer(block.data, dtype=np.uint8, count=size)
        weakref.finalize(handed_out, self._take_back, block).atexit = False
        return handed_out

    def drop(self) -> None:
        """Give back to the system what waits."""
        self._idle.clear()

    def _take_back(self, block: ByteArray) -> None:
        self._idle.append(block)
        while self.idle_bytes > self._max_idle_bytes:
            with suppress(IndexError):
                self._idle.popleft()

    def _take(self, size: int) -> ByteArray | None:
        """Return a block that has waited, or None if none fits."""
        # No lock: memory may be given back at any moment, by this very thread, too.
        for _ in range(len(self._idle)):
            try:
                block = self._idle.popleft()
            except IndexError:
                return None
            if size <= block.nbytes <= MAX_WASTE * size:
                return block
            self._idle.append(block)
        return None
