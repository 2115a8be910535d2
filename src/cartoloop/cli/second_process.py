# SPDX-License-Identifier: Apache-2.0
"""A second process that compiles further kernels while this one starts its first run."""

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
"""Time to end by itself before the process is killed [s]."""


def start_second_process() -> bool:
    """Start a process that compiles kernels needed later; it ends with this one.

    Return whether it was started. If it fails, this process compiles everything itself.
    """
    from cartoloop.compile_ahead import is_done

    if is_done() or _num_processors() < 2 or not sys.executable or getattr(sys, "frozen", False):
        return False
    try:
        process = subprocess.Popen(
            # -P: modules are not imported from the working directory.
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
    """Wait for its end, and log its errors."""
    assert process.stderr is not None
    with process.stderr as stream:
        errors = stream.read().decode(errors="replace").strip()
    if process.wait() or errors:
        _logger.debug("compiling kernels ahead: status %d: %s", process.returncode, errors)


def _end(process: subprocess.Popen[bytes], waiter: threading.Thread) -> None:
    """End the process, whose kernels are not needed any more."""
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
