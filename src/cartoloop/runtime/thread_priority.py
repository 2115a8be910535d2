# SPDX-License-Identifier: Apache-2.0
"""Priorities of threads, for when there are more busy threads than processors."""

from __future__ import annotations

import os
import sys
import threading
from contextlib import suppress

BACKGROUND_NICENESS = 5
"""Nice value of background threads above that of the process: a third of a normal share."""


def lower_thread_priority(niceness: int = BACKGROUND_NICENESS) -> None:
    """Lower the priority of this thread and of the threads that it starts from now on.

    Only on Linux, where threads have priorities of their own; elsewhere this does nothing.

    Parameters
    ----------
    niceness : increase of the nice value.
    """
    if sys.platform != "linux":
        return
    thread = threading.get_native_id()
    with suppress(OSError):  # forbidden in some containers: all threads are equal then
        os.setpriority(os.PRIO_PROCESS, thread, os.getpriority(os.PRIO_PROCESS, thread) + niceness)
