# SPDX-License-Identifier: Apache-2.0
"""Commands of cartoloop in processes of their own, and what each of them took."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from cartoloop.errors import CartoloopError


@dataclass(frozen=True, slots=True)
class CommandRun:
    """What a command took, start of the interpreter included.

    Attributes
    ----------
    wall_s, cpu_s : time, and processor time of all its threads [s].
    peak_memory_mb : most memory that it held at any time [MB].
    """

    wall_s: float
    cpu_s: float
    peak_memory_mb: float


class CommandFailed(CartoloopError):  # noqa: N818 - named for what happened
    """A command ended with an error; its last line says which."""


def run_command(*arguments: str | Path) -> CommandRun:
    """Run ``cartoloop`` with these arguments, alone, and return what it took.

    Raises
    ------
    CommandFailed
        It ended with another status than 0, or this system does not tell what a process took.
    """
    if not hasattr(os, "wait4"):
        raise CommandFailed("whole commands can be measured on Linux and macOS only")
    command = [sys.executable, "-m", "cartoloop", *map(str, arguments)]
    with tempfile.TemporaryFile() as said:
        start = perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said)
        try:
            _, status, usage = os.wait4(process.pid, 0)
        except BaseException:
            process.terminate()
            process.wait()
            raise
        wall_s = perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            said.seek(0)
            lines = said.read().decode("utf-8", "replace").strip().splitlines()
            last = lines[-1] if lines else "it said nothing"
            raise CommandFailed(
                f"'cartoloop {' '.join(map(str, arguments))}' ended with status "
                f"{process.returncode}: {last}"
            )
    bytes_a_unit = 1 if sys.platform == "darwin" else 1024
    return CommandRun(wall_s, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * bytes_a_unit / 1e6)
