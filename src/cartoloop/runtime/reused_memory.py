# SPDX-License-Identifier: Apache-2.0
"""A pool of memory for large arrays with short lives.

The system clears new memory page by page as it is touched, which takes longer than most of what is
then computed in it. The blocks that the C library keeps seldom fit the next array, and their total
is not limited.
"""

from __future__ import annotations

import weakref
from collections import deque
from contextlib import suppress

import numpy as np

from cartoloop.arrays import ByteArray

MAX_WASTE = 2
"""Largest ratio of a block to the array in it: in a larger block the rest would be wasted."""

_ALL: weakref.WeakSet[ReusedMemory] = weakref.WeakSet()


def drop_idle_memory() -> None:
    """Return the idle blocks of all pools to the system."""
    for memory in list(_ALL):
        memory.drop()


class ReusedMemory:
    """A pool of arrays of bytes; safe to use from several threads at once.

    Parameters
    ----------
    max_idle_bytes : limit of the idle blocks; beyond it, the blocks idle for longest are returned
        to the system.
    """

    def __init__(self, max_idle_bytes: int) -> None:
        self._max_idle_bytes = max_idle_bytes
        self._idle: deque[ByteArray] = deque()
        _ALL.add(self)

    @property
    def idle_bytes(self) -> int:
        """Total size of the idle blocks [bytes]."""
        return sum(block.nbytes for block in list(self._idle))

    def array(self, size: int) -> ByteArray:
        """Return uint8, shape (size,), not initialized.

        Its memory is reused once no reference to it or to a view of it is left.
        """
        block = self._take(size)
        if block is None:
            block = np.empty(size, dtype=np.uint8)
        # Views of an array made from a buffer keep that array alive, not only its memory.
        handed_out: ByteArray = np.frombuffer(block.data, dtype=np.uint8, count=size)
        weakref.finalize(handed_out, self._take_back, block).atexit = False
        return handed_out

    def drop(self) -> None:
        """Return the idle blocks to the system."""
        self._idle.clear()

    def _take_back(self, block: ByteArray) -> None:
        self._idle.append(block)
        while self.idle_bytes > self._max_idle_bytes:
            with suppress(IndexError):
                self._idle.popleft()

    def _take(self, size: int) -> ByteArray | None:
        """Return an idle block, or None if none fits."""
        # No lock: a block may be given back at any moment, even in this thread.
        for _ in range(len(self._idle)):
            try:
                block = self._idle.popleft()
            except IndexError:
                return None
            if size <= block.nbytes <= MAX_WASTE * size:
                return block
            self._idle.append(block)
        return None
