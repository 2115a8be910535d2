# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: T201 - it prints a table
"""Map the Radish logs of the paper with the defaults and print the table of docs/results.md.

Run: python benchmarks/radish.py [LOG ...]     (finds the recordings through CARTOLOOP_DATA)

Each log is mapped by the command line, as a user would, one after the other; the figures are read
from what it wrote. The kernels are compiled before the first is timed.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

LOGS = ("mit-csail", "fr079", "intel", "aces", "mit-killian")
COLUMNS = (
    "log",
    "translation m",
    "rotation deg",
    "before loop closure",
    "nodes / submaps",
    "closures",
    "precision",
    "of those searched",
    "CPU s",
    "wall s",
    "times real time",
    "peak MB",
)


def cartoloop(*arguments: str | Path) -> str:
    """Run a cartoloop command and return what it prints."""
    command = [sys.executable, "-m", "cartoloop", *map(str, arguments)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def relations_error(trajectory: Path, relations: Path) -> tuple[str, str]:
    """Return mean and standard deviation of both errors, as in table II; a dash without truth."""
    if not relations.exists():
        return "-", "-"
    found = json.loads(cartoloop("evaluate", "relations", trajectory, relations, "--json"))
    translation, rotation = found["absolute_translational"], found["absolute_rotational_deg"]
    return (
        f"{translation['mean']:.4f} ± {translation['std']:.4f}",
        f"{rotation['mean']:.3f} ± {rotation['std']:.3f}",
    )


def row(name: str, data: Path, out: Path) -> list[str]:
    """Map one log and return its row of the table."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    cartoloop("map", data / f"{name}.clf.gz", "-o", out)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    report = json.loads((out / "report.json").read_text())
    relations = data / f"{name}.relations"
    translation, rotation = relations_error(out / "trajectory.tum", relations)
    local = " m, ".join(
        part.split(" ")[0] for part in relations_error(out / "local_trajectory.tum", relations)
    )
    constraints = report["constraints"]
    return [
        name,
        translation,
        rotation,
        f"{local} deg" if relations.exists() else "-",
        f"{report['nodes']} / {report['submaps']}",
        str(constraints["loop_closure"]),
        f"{100 * constraints['precision']:.1f} %",
        f"{100 * constraints['found_precision']:.1f} %",
        f"{cpu:.1f}",
        f"{report['wall_s']:.1f}",
        f"{report['real_time_factor']:.0f}",
        f"{report['peak_memory_mb']:.0f}",
    ]


def main() -> None:
    """Print the table in Markdown."""
    data = Path(os.environ.get("CARTOLOOP_DATA", "../shared/data")) / "radish"
    logs = sys.argv[1:] or LOGS
    print("|" + "|".join(f" {column} " for column in COLUMNS) + "|")
    print("|" + " --- |" * len(COLUMNS), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        cartoloop("demo", "-o", Path(folder) / "demo")
        for name in logs:
            cells = row(name, data, Path(folder) / name)
            print("|" + "|".join(f" {cell} " for cell in cells) + "|", flush=True)


if __name__ == "__main__":
    main()
