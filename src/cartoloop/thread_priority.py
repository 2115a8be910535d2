# SPDX-License-Identifier: Apache-2.0
"""Which threads come first where there are fewer processors than threads with something to do."""

from __future__ import annotations

import os
import sys
import threading
from contextlib import suppress

STEPS_BACK = 5
"""Nice value, above that of the process, of threads that nobody waits for: a third of the share."""


def step_back(steps: int = STEPS_BACK) -> None:
    """Have this thread, and those that it starts from now on, give way to the others.

    Only where the system knows priorities of threads (Linux); elsewhere nothing happens.

    Parameters
    ----------
    steps : by how much its nice value rises.
    """
    if sys.platform != "linux":
        return
    thread = threading.get_native_id()
    with suppress(OSError):  # forbidden by a container: all are equal then
        os.setpriority(os.PRIO_PROCESS, thread, os.getpriority(os.PRIO_PROCESS, thread) + steps)
