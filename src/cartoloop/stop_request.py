# SPDX-License-Identifier: Apache-2.0
"""A request to stop a run, from a signal handler or another thread."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class StopRequest:
    """Whether a run should stop.

    Attributes
    ----------
    made : set it, from a signal handler or another thread, to stop after the current event.
    """

    def __init__(self) -> None:
        self.made = False
        self.is_immediate = False
        self.is_shielded = False

    @contextmanager
    def shielded(self) -> Iterator[None]:
        """Mark the body as one that must not stay half done: no signal handler may interrupt it.

        A request is noted, and heeded after the body.
        """
        self.is_shielded = True
        try:
            yield
        finally:
            self.is_shielded = False

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Mark the body as one that does not check `made`: a signal handler must interrupt it.

        Raises
        ------
        KeyboardInterrupt
            At once if the request was made before.
        """
        self.is_immediate = True
        try:
            if self.made:
                raise KeyboardInterrupt
            yield
        finally:
            self.is_immediate = False
