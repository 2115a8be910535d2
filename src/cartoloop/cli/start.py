# SPDX-License-Identifier: Apache-2.0
"""The program, from its first moment: while its modules are loaded, Ctrl-C ends it in silence."""

from __future__ import annotations

import gc
import signal
import sys

GARBAGE_THRESHOLD = 100_000
"""Objects between two searches for unreachable cycles. Nearly all objects of a run are freed
without; by default, modules that are loaded are searched again and again."""


def main() -> None:
    """Run the command line of this process."""
    gc.set_threshold(GARBAGE_THRESHOLD)
    takes_interrupts = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if takes_interrupts:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from cartoloop.cli.main import main as run_command_line

    if takes_interrupts:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        run_command_line()
    except KeyboardInterrupt:  # between two commands of `main`
        sys.exit(130)
