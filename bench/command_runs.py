# SPDX-License-Identifier: Apache-2.0
"""Commands of cartoloop in processes of their own, and what each of them took."""

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
    words = [str(argument) for argument in arguments]
    with tempfile.TemporaryDirectory(prefix="cartoloop-run-") as folder:
        said = Path(folder) / "said.txt"
        child = [sys.executable, "-I", "-S", measured_child.__file__, str(said)]
        command = [sys.executable, "-m", "cartoloop", *words]
        done = subprocess.run([*child, *command], capture_output=True, text=True, check=False)
        told = json.loads(done.stdout) if done.returncode == 0 else {"status": done.returncode}
        if told["status"] != 0:
            text = said.read_text("utf-8", "replace") if said.exists() else done.stderr
            raise failure(f"'cartoloop {' '.join(words)}'", told["status"], text)
    bytes_a_unit = 1 if sys.platform == "darwin" else 1024
    return CommandRun(told["wall_s"], told["cpu_s"], told["max_rss"] * bytes_a_unit / 1e6)


def run_module(what: str, module: str, *arguments: object) -> str:
    """Run a module of the benchmarks in a process of its own and return what it prints.

    Parameters
    ----------
    what : what it does, for the message if it fails.
    module : its name within ``bench``.

    Raises
    ------
    CommandFailed
        It ended with another status than 0.
    """
    command = [sys.executable, "-m", f"bench.{module}", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise failure(what, done.returncode, done.stderr)
    return done.stdout


def failure(what: str, status: int, said: str) -> CommandFailed:
    """Return the error for a process that ended with a status, of the last line that it said."""
    lines = said.strip().splitlines() or ["it said nothing"]
    return CommandFailed(f"{what} ended with status {status}: {lines[-1]}")
