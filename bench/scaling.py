# SPDX-License-Identifier: Apache-2.0
"""``python -m bench scaling``: time per node and memory of a run many museums long."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

from bench.command_runs import run_command, run_module
from bench.environment import environment
from bench.growth import Checkpoint
from bench.record import Figure, Record, Row


def name_of(again: bool) -> str:
    """Return the name of the record."""
    return "scaling-again" if again else "scaling"


def run(
    times: int,
    *,
    again: bool,
    progress: Callable[[str], None],
    seed: int = 0,
    repeats: int = 1,
) -> Record:
    """Return the cost of each museum's length of a run, and of the last pass over all.

    Parameters
    ----------
    times : length of the run, in museums; also the number of parts.
    again : whether one museum is walked through again and again; otherwise the building grows
        with the path.
    progress : called with a line on progress.
    seed : of the building, the walks and all noise.
    repeats : of the whole run.

    Notes
    -----
    The recording is simulated into a file first. Reading and mapping it is measured.
    """
    from cartoloop.simulation import simulate
    from cartoloop.simulation.museum import large_museum, museum_again

    with tempfile.TemporaryDirectory(prefix="cartoloop-scaling-") as folder:
        log = Path(folder) / "museums.log"
        progress("warming up: compiling kernels where they are not yet")
        run_command("demo", "-o", Path(folder) / "demo")
        progress(f"simulating {times} museums")
        world = museum_again(seed, times) if again else large_museum(seed, times)
        recording = simulate(world, seed=seed)
        recording.write_carmen(log)
        duration = float(recording.stamps[-1] - recording.stamps[0])
        progress(f"mapping {len(recording.stamps)} scans, {repeats} times")
        del recording
        runs = [_grow(log, times) for _ in range(repeats)]
    parts = zip(*(pairwise(points[:-1]) for points in runs), strict=True)
    rows = [_part(f"{part} to {part + 1}", passes) for part, passes in enumerate(parts)]
    rows.append(_part("last pass", [(points[-2], points[-1]) for points in runs]))
    rows.append(_whole([points[-1] for points in runs], duration))
    return Record(name_of(again), tuple(rows), environment())


def _grow(log: Path, num_checkpoints: int) -> list[Checkpoint]:
    output = run_module(f"mapping {log.name}", "growth", log, num_checkpoints)
    return [Checkpoint(**point) for point in json.loads(output)]


def _part(name: str, passes: Sequence[tuple[Checkpoint, Checkpoint]]) -> Row:
    """Return the cost between two checkpoints in each run; the last pass counts for all nodes."""
    before, after = passes[0]
    nodes = (after.nodes - before.nodes) or after.nodes
    cpu = [after.cpu_s - before.cpu_s for before, after in passes]
    wall = [after.wall_s - before.wall_s for before, after in passes]
    return Row({"museums": name}, _figures([after for _, after in passes], cpu, wall, nodes))


def _whole(last: Sequence[Checkpoint], duration: float) -> Row:
    cpu, wall = [point.cpu_s for point in last], [point.wall_s for point in last]
    figures = _figures(last, cpu, wall, last[0].nodes)
    real_time = Figure.of_samples([duration / seconds for seconds in wall], "", "more")
    return Row({"museums": "whole"}, figures | {"times real time": real_time})


def _figures(
    points: Sequence[Checkpoint], cpu_s: Sequence[float], wall_s: Sequence[float], nodes: int
) -> dict[str, Figure]:
    """Return the figures of a part: in each run, the state at its end and its cost."""
    return {
        "nodes so far": Figure.exact(points[0].nodes, better=None),
        "closures so far": Figure.exact(points[0].closures, better=None),
        "CPU": Figure.of_samples(cpu_s, "s"),
        "wall clock": Figure.of_samples(wall_s, "s"),
        "CPU a node": Figure.of_samples([1e3 * seconds / nodes for seconds in cpu_s], "ms"),
        "peak memory": Figure.of_samples([point.memory_mb for point in points], "MB"),
    }
