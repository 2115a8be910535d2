# SPDX-License-Identifier: Apache-2.0
"""Uses a range of inputs, one after the other, and says of each what came of it.

``python -m bench.fuzz.worker FOLDER SEED FIRST LAST [TARGET]``. It writes a line of JSON before and
after each input, so that the process that reads them knows which one crashed it.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from random import Random
from types import FrameType
from typing import NamedTuple

from bench.fuzz.seeds import Seeds
from bench.fuzz.targets import TARGETS, Target
from cartoloop.errors import CartoloopError
from cartoloop.plain_text import one_line

LIMIT_S = 10.0
"""Longest time for an input [s]."""

LIMIT_MB = 512
"""Most memory that the process may hold [MB]."""

PASSED = ("fine", "stated")
"""What may come of an input: it is used, or refused with a stated error."""

_ADDRESS_SPACE = 2 << 30
"""Beyond that of the start: what is asked for at once fails where it is asked for [bytes]."""


class Outcome(NamedTuple):
    """What came of an input.

    Attributes
    ----------
    number, target : of the input, and its kind.
    what : "begun", "fine", "stated", or the kind of failure.
    details : of a failure.
    arguments : what it was called with; the first is mostly the path of the input.
    seconds : that it took [s].
    """

    number: int
    target: str
    what: str
    details: str
    arguments: list[str]
    seconds: float = 0.0


class TooLongError(BaseException):
    """An input takes too long. Not an `Exception`, so that nothing handles it."""


def outcome_of(target: Target, arguments: list[str]) -> tuple[str, str]:
    """Return what came of an input: "fine", "stated" or the kind of failure, and the details."""
    try:
        signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
        try:
            target.use(arguments)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
    except CartoloopError as error:
        text = str(error)
        return ("stated", "") if text == one_line(text) else ("unprintable", repr(text))
    except TooLongError:
        return "too long", traceback.format_exc()
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return type(error).__name__, traceback.format_exc()
    held = most_held_mb()
    return ("too large", f"{held:.0f} MB") if held > LIMIT_MB else ("fine", "")


def most_held_mb() -> float:
    """Return the most memory that this process has held [MB].

    `getrusage` counts what its parent held when it started this one, too.
    """
    status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    return float(status.split("VmHWM:")[1].split()[0]) / 1024


def input_folder(folder: Path, number: int) -> Path:
    """Return the folder of an input; it is removed unless the input fails."""
    return folder / f"input-{number}"


def run_range(seeds: Seeds, seed: int, first: int, last: int, only: str = "") -> Iterator[Outcome]:
    """Yield the outcome of each input of a range; the same seed and number give the same input."""
    targets = [target for target in TARGETS if only in ("", target.name)]
    weights = [target.weight for target in targets]
    for number in range(first, last):
        random = Random(f"{seed}/{number}")
        [target] = random.choices(targets, weights)
        work = input_folder(seeds.folder, number)
        work.mkdir()
        os.chdir(work)
        arguments = target.make(random, seeds, work)
        yield Outcome(number, target.name, "begun", "", arguments)
        start = time.perf_counter()
        what, details = outcome_of(target, arguments)
        seconds = time.perf_counter() - start
        os.chdir(seeds.folder)
        if what in PASSED:
            shutil.rmtree(work, ignore_errors=True)
        yield Outcome(number, target.name, what, details, arguments, seconds)


def main() -> None:
    """Run the range in the arguments."""
    folder, seed, first, last, *only = sys.argv[1:]
    signal.signal(signal.SIGALRM, _interrupt)
    with (Path(folder) / "contents.json").open(encoding="ascii") as file:
        contents = json.load(file)
    seeds = Seeds(
        Path(folder),
        {kind: [bytes.fromhex(text) for text in texts] for kind, texts in contents.items()},
    )
    for target in TARGETS:  # sound inputs first: kernels are compiled or loaded, modules imported
        _warm_up(target, seeds)
    now = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = now * resource.getpagesize() + _ADDRESS_SPACE
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    output = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
    os.dup2(2, 1)
    for outcome in run_range(seeds, int(seed), int(first), int(last), *only):
        output.write(json.dumps(outcome._asdict()) + "\n")
        if outcome.what == "too large":
            break  # what follows would seem too large, too


def _warm_up(target: Target, seeds: Seeds) -> None:
    folder = seeds.folder / f"warm-{os.getpid()}"
    folder.mkdir(exist_ok=True)
    os.chdir(folder)
    with suppress(CartoloopError):
        target.use(target.make(Random(1), seeds, folder))
    os.chdir(seeds.folder)
    shutil.rmtree(folder, ignore_errors=True)


def _interrupt(_: int, __: FrameType | None) -> None:
    raise TooLongError


if __name__ == "__main__":
    main()
