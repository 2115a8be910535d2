# SPDX-License-Identifier: Apache-2.0
"""Files that several tests read are made once in a test session, by one of its processes."""

from __future__ import annotations

import os
from contextlib import contextmanager

try:
    import fcntl
except ImportError:  # Windows: each process makes its own files
    fcntl = None


class SharedFiles:
    """A folder shared by the processes of a test session.

    Parameters
    ----------
    base : the base temporary directory of this process; those of the processes of pytest-xdist
        are subfolders of one folder.
    """

    def __init__(self, base):
        is_shared = fcntl is not None and "PYTEST_XDIST_WORKER" in os.environ
        self._folder = (base.parent if is_shared else base) / "shared"
        self._folder.mkdir(exist_ok=True)

    def path(self, name, make):
        """Return the file or folder `name`; the first process that asks calls ``make(path)``."""
        path, done = self._folder / name, self._folder / f"{name}.done"
        with self._lock(name):
            if not done.exists():
                make(path)
                done.touch()
        return path

    @contextmanager
    def _lock(self, name):
        with (self._folder / f"{name}.lock").open("w") as file:
            if fcntl is not None:
                fcntl.flock(file, fcntl.LOCK_EX)  # released when the file is closed
            yield
