# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: T201 - its output is read by the process that started it
"""Mapping with a live view, in a process of its own.

Run: ``python -m bench.view.mapping cost LOG SCANS REPEATS OUT VIEWERS...``; maps the recording with
each number of viewers, and without a view, in turn; prints the costs as JSON and saves the map. Or
``... closures LOG SCANS PACE``; prints the URL of the view, waits for a line, maps, and prints the
numbers of loop closures with their times as JSON.
"""

from __future__ import annotations

import gc
import json
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from time import perf_counter, process_time, sleep, time

from bench.view.clients import Seen
from cartoloop.config import Config
from cartoloop.live.warm_up import warm_up
from cartoloop.mapper import Mapper
from cartoloop.readers import open_log
from cartoloop.result import Result
from cartoloop.sensor.events import SensorEvent
from cartoloop.viewer.view import LiveView

_LAST_UPDATES, _LAST_UPDATE_S = 20, 0.1
"""Number of updates of the view after the last scan, and the time between them [s]."""


@dataclass(frozen=True, slots=True)
class MappingRun:
    """The cost of mapping a recording.

    Attributes
    ----------
    viewers : number of viewers; None without a view.
    wall_s, cpu_s : time, and processor time of all threads of the process [s], until the last scan.
    finish_wall_s, finish_cpu_s : of the last pass.
    sent_mb : to each viewer [MB].
    """

    viewers: int | None
    wall_s: float
    cpu_s: float
    finish_wall_s: float
    finish_cpu_s: float
    sent_mb: float


def measure(events: Sequence[SensorEvent], viewers: int | None) -> tuple[MappingRun, Result]:
    """Return the cost of mapping with a number of viewers, and the map."""
    if viewers is None:
        return _map(events, None, None)
    view = LiveView("recording", Config(), port=0)
    command = [sys.executable, "-m", "bench.view.clients", view.url, str(viewers)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as pages:
        assert pages.stdout is not None
        pages.stdout.readline()
        try:
            run, result = _map(events, viewers, view)
            view.finished(result)
        finally:
            view.close()
        if view.failure is not None:
            raise view.failure
        sent = json.loads(pages.stdout.read())
    return MappingRun(**asdict(run) | {"sent_mb": sum(sent) / len(sent) / 1e6}), result


def _map(
    events: Iterable[SensorEvent], viewers: int | None, view: LiveView | None
) -> tuple[MappingRun, Result]:
    mapper = Mapper()
    gc.collect()
    start = perf_counter(), process_time()
    for event in events:
        if view is not None:
            view.before_event(mapper, event, lambda: False)
        mapper.add(event)
        if view is not None:
            view.after_event(mapper)
    mapped = perf_counter(), process_time()
    result = mapper.finish(None if view is None else lambda stage: view.finishing(stage, mapper))
    end = perf_counter(), process_time()
    return (
        MappingRun(
            viewers, mapped[0] - start[0], mapped[1] - start[1], end[0] - mapped[0],
            end[1] - mapped[1], 0.0,
        ),
        result,
    )  # fmt: skip


def cost(
    events: Sequence[SensorEvent], repeats: int, viewers: Sequence[int], out: Path
) -> list[MappingRun]:
    """Return all runs: in each repeat once without a view and once with each number of viewers."""
    kinds: list[int | None] = [None, *viewers]
    warm_up()
    runs = []
    for repeat in range(repeats):
        for number in range(len(kinds)):  # each repeat begins with another kind
            run, result = measure(events, kinds[(repeat + number) % len(kinds)])
            runs.append(run)
    result.save(out)
    return runs


def find_closures(events: Sequence[SensorEvent], pace: float) -> list[Seen]:
    """Print a view's URL, wait for a line, map; return the numbers of closures with the times."""
    view = LiveView("recording", Config(), port=0, speed=pace)
    warm_up()
    print(view.url, flush=True)
    sys.stdin.readline()
    mapper = Mapper()
    found: list[Seen] = []
    for event in events:
        view.before_event(mapper, event, lambda: False)
        mapper.add(event)
        view.after_event(mapper)
        if mapper.num_loop_closures > (found[-1][0] if found else 0):
            found.append((mapper.num_loop_closures, time()))
    mapper.close()
    for _ in range(_LAST_UPDATES):  # until the page has the last ones
        view.after_event(mapper)
        sleep(_LAST_UPDATE_S)
    view.close()
    return found


def main() -> None:
    """Run the part that the arguments name."""
    what, log, scans, *rest = sys.argv[1:]
    events = list(islice(open_log(Path(log)), int(scans) or None))
    if what == "cost":
        repeats, out, *viewers = rest
        runs = cost(events, int(repeats), [int(number) for number in viewers], Path(out))
        print(json.dumps([asdict(run) for run in runs]))
    else:
        print(json.dumps(find_closures(events, float(rest[0]))))


if __name__ == "__main__":
    main()
