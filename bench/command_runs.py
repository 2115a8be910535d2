# SPDX-License-Identifier: Apache-2.0
"""Run commands in processes of their own and measure their time and memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from bench import measured_child
from cartoloop.errors import CartoloopError


@dataclass(frozen=True, slots=True)
class CommandRun:
    """The cost of a command, including the start of the interpreter.

    Attributes
    ----------
    wall_s, cpu_s : wall-clock time, and processor time of all threads [s].
    peak_memory_mb : peak resident memory [MB].
    """

    wall_s: float
    cpu_s: float
    peak_memory_mb: float


class CommandFailed(CartoloopError):  # noqa: N818 - named for what happened
    """A command failed; the message has the last line of its output."""


def run_command(*arguments: str | Path) -> CommandRun:
    """Run ``cartoloop`` with these arguments and return its cost.

    Raises
    ------
    CommandFailed
        It ended with a status other than 0, or this system does not measure processes.
    """
    if not hasattr(os, "wait4"):
        raise CommandFailed("whole commands can be measured on Linux and macOS only")
    words = [str(argument) for argument in arguments]
    with tempfile.TemporaryDirectory(prefix="cartoloop-run-") as folder:
        output = Path(folder) / "output.txt"
        child = [sys.executable, "-I", "-S", measured_child.__file__, str(output)]
        command = [sys.executable, "-m", "cartoloop", *words]
        done = subprocess.run([*child, *command], capture_output=True, text=True, check=False)
        measured = json.loads(done.stdout) if done.returncode == 0 else {"status": done.returncode}
        if measured["status"] != 0:
            text = output.read_text("utf-8", "replace") if output.exists() else done.stderr
            raise failure(f"'cartoloop {' '.join(words)}'", measured["status"], text)
    bytes_a_unit = 1 if sys.platform == "darwin" else 1024
    return CommandRun(
        measured["wall_s"], measured["cpu_s"], measured["max_rss"] * bytes_a_unit / 1e6
    )


def run_module(what: str, module: str, *arguments: object) -> str:
    """Run a module of the benchmarks in a process of its own and return what it prints.

    Parameters
    ----------
    what : what it does, for the error message.
    module : its name within ``bench``.

    Raises
    ------
    CommandFailed
        It ended with a status other than 0.
    """
    command = [sys.executable, "-m", f"bench.{module}", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise failure(what, done.returncode, done.stderr)
    return done.stdout


def failure(what: str, status: int, output: str) -> CommandFailed:
    """Return the error for a process that failed, with the last line of its output."""
    lines = output.strip().splitlines() or ["there is no output"]
    return CommandFailed(f"{what} ended with status {status}: {lines[-1]}")
