# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: T201 - its output is read by the process that started it
"""One long run in a process of its own, measured at checkpoints.

Run: ``python -m bench.growth LOG CHECKPOINTS``; prints a JSON of checkpoints.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from cartoloop.mapper import Mapper
from cartoloop.readers import open_log
from cartoloop.runtime.process_memory import peak_memory_mb, relax_gc, set_malloc_thresholds


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """The state of a run.

    Attributes
    ----------
    scans, nodes, closures : so far.
    wall_s, cpu_s : time, and processor time of all threads, since mapping began [s].
    memory_mb : peak memory so far [MB].
    is_finished : whether the last pass is done.
    """

    scans: int
    nodes: int
    closures: int
    wall_s: float
    cpu_s: float
    memory_mb: float
    is_finished: bool = False


def grow(path: Path, num_checkpoints: int) -> list[Checkpoint]:
    """Map a recording and return its state after each part of its scans, and at the end."""
    log = open_log(path)
    every = max(1, log.num_scans // num_checkpoints)
    wall, cpu = time.perf_counter(), time.process_time()
    mapper = Mapper()

    def now(is_finished: bool = False) -> Checkpoint:
        return Checkpoint(
            mapper.num_scans,
            mapper.num_nodes,
            mapper.num_loop_closures,
            time.perf_counter() - wall,
            time.process_time() - cpu,
            peak_memory_mb(),
            is_finished,
        )

    found = [now()]
    for event in log:
        mapper.add(event)
        if mapper.num_scans >= every * len(found) and len(found) <= num_checkpoints:
            found.append(now())
    mapper.finish()
    return [*found, now(is_finished=True)]


def main() -> None:
    """Print the checkpoints of the run that the arguments name."""
    set_malloc_thresholds()
    relax_gc()
    print(json.dumps([asdict(point) for point in grow(Path(sys.argv[1]), int(sys.argv[2]))]))


if __name__ == "__main__":
    main()
