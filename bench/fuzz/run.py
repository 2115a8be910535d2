# SPDX-License-Identifier: Apache-2.0
"""Runs inputs in processes of their own, and collects what came of them.

An input fails that ends in another than a stated error, crashes its process, takes longer than ten
seconds, or has it hold more than 512 MB. It is kept, with what it raised, in the folder of results.
"""

from __future__ import annotations

import json
import os
import selectors
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO

from bench.environment import environment
from bench.fuzz.seeds import Seeds, make_seeds
from bench.fuzz.worker import LIMIT_S, PASSED, Outcome, input_folder
from bench.record import Figure, Record, Row

LONGEST_RANGE = 10_000
"""Inputs of a process at most: its memory is that of these, not of all before."""

_START_S = 120.0
"""Time for a process to start and compile [s]."""


@dataclass
class Results:
    """What came of all inputs.

    Attributes
    ----------
    counts : number of inputs by kind and what came of them.
    failures : those that failed.
    longest : the input that took longest.
    longest_s : the longest time by kind [s].
    """

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    failures: list[Outcome] = field(default_factory=list)
    longest: Outcome | None = None
    longest_s: dict[str, float] = field(default_factory=dict)

    def add(self, outcome: Outcome) -> None:
        """Add the outcome of one input."""
        self.counts[outcome.target, outcome.what] += 1
        if outcome.what not in PASSED:
            self.failures.append(outcome)
        target, seconds = outcome.target, outcome.seconds
        self.longest_s[target] = max(seconds, self.longest_s.get(target, 0.0))
        if self.longest is None or seconds > self.longest.seconds:
            self.longest = outcome

    @property
    def total(self) -> int:
        """Number of inputs."""
        return sum(self.counts.values())

    def record(self) -> Record:
        """Return the counts by kind of input, and of all."""
        targets = sorted({target for target, _ in self.counts})
        rows = [self._row(name, [name]) for name in targets]
        return Record("fuzz", (*rows, self._row("all", targets)), environment())

    def _row(self, name: str, targets: Sequence[str]) -> Row:
        counts: Counter[str] = Counter()
        for (target, what), count in self.counts.items():
            counts[what] += count if target in targets else 0
        failures = counts.total() - sum(counts[what] for what in PASSED)
        return Row(
            {"input": name},
            {
                "inputs": Figure.exact(counts.total(), better=None),
                "used": Figure.exact(counts["fine"], better=None),
                "refused": Figure.exact(counts["stated"], better=None),
                "failures": Figure.exact(failures),
                "longest": Figure(max(self.longest_s[target] for target in targets), "s"),
            },
        )

    def table(self) -> str:
        """Return the counts by kind of input, for the terminal."""
        kinds = sorted({what for _, what in self.counts})
        targets = sorted({target for target, _ in self.counts})
        rows = [("input", *kinds)]
        rows += [(name, *(str(self.counts[name, kind]) for kind in kinds)) for name in targets]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ]
        assert self.longest is not None
        lines.append(
            f"\n{self.total} inputs, {len(self.failures)} failures; longest "
            f"{self.longest.seconds:.2f} s (number {self.longest.number}, {self.longest.target})"
        )
        return "\n".join(lines)


@dataclass(frozen=True, kw_only=True)
class FuzzOptions:
    """Which inputs are run, and how.

    Attributes
    ----------
    seed, first, count : which inputs: the same numbers are the same inputs.
    num_processes : that run at a time.
    out : folder for the inputs that fail.
    data : folder of recordings that are changed too, or None.
    only : name of the one kind of input; all if empty.
    """

    seed: int
    first: int
    count: int
    num_processes: int
    out: Path
    data: Path | None = None
    only: str = ""


def run_all(options: FuzzOptions, report: Callable[[str], None]) -> Results:
    """Run inputs, keep those that fail, and return what came of all.

    Parameters
    ----------
    report : receives a line for each failure, and one now and then; in any thread.

    Raises
    ------
    RuntimeError
        A process fails between inputs: the fault is in the harness.
    """
    results = Results()
    last = options.first + options.count
    length = min(LONGEST_RANGE, -(-options.count // options.num_processes))
    starts = iter(range(options.first, last, length))
    with (
        _seed_folder(options.data) as seeds,
        ThreadPoolExecutor(options.num_processes) as threads,
    ):

        def work() -> None:
            for start in starts:  # shared: an iterator of integers gives each to one thread
                end = min(start + length, last)
                for outcome in _run_range(seeds.folder, options.seed, start, end, options.only):
                    results.add(outcome)
                    if outcome.what not in PASSED:
                        work_folder = input_folder(seeds.folder, outcome.number)
                        _keep(outcome, work_folder, options.out)
                        report(f"{outcome.number} {outcome.target}: {outcome.what}")
                report(f"{results.total} inputs, {len(results.failures)} failures")

        for done in [threads.submit(work) for _ in range(options.num_processes)]:
            done.result()
    return results


@contextmanager
def _seed_folder(data: Path | None) -> Iterator[Seeds]:
    with TemporaryDirectory(prefix="cartoloop-fuzz-", ignore_cleanup_errors=True) as folder:
        seeds = make_seeds(Path(folder), data)
        contents = {kind: [c.hex() for c in all_of] for kind, all_of in seeds.contents.items()}
        (Path(folder) / "contents.json").write_text(json.dumps(contents), encoding="ascii")
        yield seeds


def _run_range(folder: Path, seed: int, first: int, last: int, only: str) -> Iterator[Outcome]:
    """Yield the outcomes of a range; where an input ends its process, another one goes on."""
    with (folder / f"log-{first}").open("wb") as log:
        yield from _run_processes(folder, seed, first, last, only, log)


def _run_processes(
    folder: Path, seed: int, first: int, last: int, only: str, log: IO[bytes]
) -> Iterator[Outcome]:
    while first < last:
        arguments = [str(folder), str(seed), str(first), str(last), *([only] if only else [])]
        process = subprocess.Popen(
            [sys.executable, "-X", "faulthandler", "-m", "bench.fuzz.worker", *arguments],
            stdout=subprocess.PIPE,
            stderr=log,
            stdin=subprocess.DEVNULL,
        )
        assert process.stdout is not None
        begun: Outcome | None = None
        has_progressed = False
        for outcome in _outcomes(process.stdout):
            if outcome.what == "begun":
                begun = outcome
                continue
            begun, first, has_progressed = None, outcome.number + 1, True
            yield outcome
        if process.poll() is None:
            time.sleep(0.5)  # it closes its output before it ends
        process.kill()
        status = process.wait()
        process.stdout.close()
        if begun is not None:
            first = begun.number + 1
            what = f"ended the process ({status})" if status != -9 else "did not end"
            yield begun._replace(what=what, seconds=LIMIT_S)
        elif first < last and not has_progressed:
            said = Path(log.name).read_text(encoding="utf-8", errors="replace")[-2000:]
            raise RuntimeError(f"the process of input {first} fails ({status}): {said}")


def _outcomes(stream: IO[bytes]) -> Iterator[Outcome]:
    """Yield the outcomes that a process writes, until it ends or is silent for too long."""
    with selectors.DefaultSelector() as selector:
        selector.register(stream, selectors.EVENT_READ)
        rest, patience = b"", _START_S
        while selector.select(patience):
            data = os.read(stream.fileno(), 1 << 16)
            if not data:
                return
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                yield Outcome(**json.loads(line))
            patience = 3.0 * LIMIT_S


def _keep(outcome: Outcome, work: Path, out: Path) -> None:
    """Keep an input that failed, with what it raised."""
    folder = out / f"{outcome.target.replace(' ', '-')}-{outcome.number}"
    shutil.copytree(work, folder, dirs_exist_ok=True)
    text = f"{outcome.what}\n{outcome.arguments}\n{outcome.details}"
    (folder / "failure.txt").write_text(text, encoding="utf-8", errors="backslashreplace")
