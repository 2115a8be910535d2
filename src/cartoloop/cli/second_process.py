# SPDX-License-Identifier: Apache-2.0
"""A second process that compiles the rest, while this one begins to map for the first time."""

from __future__ import annotations

import atexit
import logging
import os
import subprocess
import sys
import threading
from contextlib import suppress

_logger = logging.getLogger(__name__)

_END_S = 2.0


def start_second_process() -> bool:
    """Have another process compile what this one needs later; it ends with this one.

    Return whether there is one. It is but a help: whatever it fails of, this one does itself.
    """
    from cartoloop.compile_ahead import is_done

    if is_done() or _num_processors() < 2 or not sys.executable or getattr(sys, "frozen", False):
        return False
    try:
        process = subprocess.Popen(
            # -P: the folder we are in is no place to import from.
            [sys.executable, "-P", "-m", "cartoloop.compile_ahead"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
    except OSError as error:
        _logger.debug("kernels are not compiled ahead: %s", error)
        return False
    waiter = threading.Thread(target=_wait, args=(process,), daemon=True, name="compile-ahead")
    waiter.start()
    atexit.register(_end, process, waiter)
    return True


def _wait(process: subprocess.Popen[bytes]) -> None:
    """Wait for its end, and keep a note of what it failed of."""
    assert process.stderr is not None
    with process.stderr as stream:
        told = stream.read().decode(errors="replace").strip()
    if process.wait() or told:
        _logger.debug("compiling kernels ahead: status %d: %s", process.returncode, told)


def _end(process: subprocess.Popen[bytes], waiter: threading.Thread) -> None:
    """End it: nobody waits for what it compiles any more."""
    assert process.stdin is not None
    with suppress(OSError):
        process.stdin.close()
    waiter.join(_END_S)
    if waiter.is_alive():
        process.kill()
        waiter.join(_END_S)


def _num_processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
