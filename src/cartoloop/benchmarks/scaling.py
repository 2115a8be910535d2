# SPDX-License-Identifier: Apache-2.0
"""Time a node and memory as one run grows to many times the museum of section VI-A."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

from cartoloop.benchmarks.command_runs import CommandFailed, run_command
from cartoloop.benchmarks.environment import environment
from cartoloop.benchmarks.growth import Checkpoint
from cartoloop.benchmarks.record import Figure, Record, Row


def run(times: int, *, again: bool, tell: Callable[[str], None], seed: int = 0) -> Record:
    """Return the cost of each museum's length of a run, and of the last pass over all.

    Parameters
    ----------
    times : length of the run, in museums; also the number of parts that are told apart.
    again : whether one museum is walked through again and again; otherwise the building grows
        with the way.
    tell : called with a line on progress.
    seed : of the building, the walks and all noise.

    Notes
    -----
    The recording is simulated before, into a file: what is measured is reading and mapping it.
    """
    from cartoloop.simulation import simulate
    from cartoloop.simulation.museum import large_museum, museum_again

    with tempfile.TemporaryDirectory(prefix="cartoloop-scaling-") as folder:
        log = Path(folder) / "museums.log"
        tell("warming up: compiling kernels where they are not yet")
        run_command("demo", "-o", Path(folder) / "demo")
        tell(f"simulating {times} museums")
        world = museum_again(seed, times) if again else large_museum(seed, times)
        recording = simulate(world, seed=seed)
        recording.write_carmen(log)
        duration = float(recording.stamps[-1] - recording.stamps[0])
        tell(f"mapping {len(recording.stamps)} scans")
        del recording
        points = _grow(log, times)
    rows = [
        _part(f"{part} to {part + 1}", before, after)
        for part, (before, after) in enumerate(pairwise(points[:-1]))
    ]
    rows.append(_part("last pass", points[-2], points[-1]))
    rows.append(_whole(points[-1], duration))
    return Record("scaling-again" if again else "scaling", tuple(rows), environment())


def _grow(log: Path, num_checkpoints: int) -> list[Checkpoint]:
    command = [sys.executable, "-m", "cartoloop.benchmarks.growth", str(log), str(num_checkpoints)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or ["it said nothing"]
        raise CommandFailed(f"mapping {log.name} ended with {done.returncode}: {lines[-1]}")
    return [Checkpoint(**point) for point in json.loads(done.stdout)]


def _part(name: str, before: Checkpoint, after: Checkpoint) -> Row:
    """Return what was done between two checkpoints; the last pass counts for all nodes."""
    nodes = (after.nodes - before.nodes) or after.nodes
    cpu, wall = after.cpu_s - before.cpu_s, after.wall_s - before.wall_s
    return Row(
        {"museums": name},
        {
            "nodes so far": Figure.exact(after.nodes, better=None),
            "closures so far": Figure.exact(after.closures, better=None),
            "CPU": Figure(cpu, "s"),
            "wall clock": Figure(wall, "s"),
            "CPU a node": Figure(1e3 * cpu / nodes, "ms"),
            "peak memory": Figure(after.memory_mb, "MB"),
        },
    )


def _whole(last: Checkpoint, duration: float) -> Row:
    return Row(
        {"museums": "whole"},
        {
            "nodes so far": Figure.exact(last.nodes, better=None),
            "closures so far": Figure.exact(last.closures, better=None),
            "CPU": Figure(last.cpu_s, "s"),
            "wall clock": Figure(last.wall_s, "s"),
            "CPU a node": Figure(1e3 * last.cpu_s / last.nodes, "ms"),
            "peak memory": Figure(last.memory_mb, "MB"),
            "times real time": Figure(duration / last.wall_s, better="more"),
        },
    )
