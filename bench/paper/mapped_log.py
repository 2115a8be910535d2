# SPDX-License-Identifier: Apache-2.0
"""A recording mapped by the command line several times, and its cost."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.command_runs import CommandFailed, CommandRun, run_command
from bench.record import Figure

TIMES_FILE = "report.json"
"""The only file of a result that holds times, and therefore differs between runs."""


@dataclass(frozen=True)
class MappedLog:
    """The result of mapping a recording, and its cost.

    Attributes
    ----------
    folder : what ``cartoloop map`` wrote.
    report : the last run's ``report.json``.
    runs : cost of each run.
    """

    folder: Path
    report: dict[str, Any]
    runs: tuple[CommandRun, ...]

    def cost(self) -> dict[str, Figure]:
        """Return the figures of table V: duration, wall clock, processor, memory, real time."""
        duration = self.report["input"]["duration_s"]
        wall = [run.wall_s for run in self.runs]
        return {
            "duration": Figure.exact(duration, "s", better=None),
            "wall clock": Figure.of_samples(wall, "s"),
            "CPU": Figure.of_samples([run.cpu_s for run in self.runs], "s"),
            "peak memory": Figure.of_samples([run.peak_memory_mb for run in self.runs], "MB"),
            "times real time": Figure.of_samples([duration / s for s in wall], "", "more"),
        }

    def size(self) -> dict[str, Figure]:
        """Return the size of the problem."""
        report = self.report
        counts = {
            "scans": report["input"]["scans"],
            "nodes": report["nodes"],
            "submaps": report["submaps"],
            "constraints": report["constraints"]["intra_submap"]
            + report["constraints"]["loop_closure"],
        }
        length = Figure.exact(report["input"]["path_length_m"], "m", better=None)
        return {name: Figure.exact(count, better=None) for name, count in counts.items()} | {
            "path length": length
        }


def map_log(
    logs: Sequence[Path],
    out: Path,
    repeats: int,
    progress: Callable[[str], None],
    settings: Sequence[str] = (),
) -> MappedLog:
    """Map a recording `repeats` times, each in a process of its own.

    Parameters
    ----------
    logs : the files of the recording.
    out : folder for the result.
    repeats : number of runs.
    progress : called with a line before each run.
    settings : parameters that are not the defaults, as ``key=value``.

    Raises
    ------
    CommandFailed
        A run failed, or its output differs from that of the first run.
    """
    options = [word for setting in settings for word in ("--set", setting)]
    runs = []
    first: dict[str, str] = {}
    for repeat in range(repeats):
        progress(f"mapping {logs[0].name}, run {repeat + 1} of {repeats}")
        runs.append(run_command("map", *logs, "-o", out, "--overwrite", *options))
        found = _digests(out)
        if first and found != first:
            changed = ", ".join(sorted(name for name in found if found[name] != first.get(name)))
            raise CommandFailed(f"mapping {logs[0].name} again gave another {changed}")
        first = found
    report = json.loads((out / TIMES_FILE).read_text(encoding="utf-8"))
    return MappedLog(out, report, tuple(runs))


def _digests(folder: Path) -> dict[str, str]:
    return {
        file.name: hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(folder.iterdir())
        if file.is_file() and file.name != TIMES_FILE
    }
