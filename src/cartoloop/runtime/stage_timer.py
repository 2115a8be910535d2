# SPDX-License-Identifier: Apache-2.0
"""Durations of named stages, cheap enough to measure every scan."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from threading import Lock
from time import perf_counter
from types import TracebackType

MAX_KEPT = 8192
"""Durations of a stage that are kept: a robot that drives for days must not fill the memory."""


@dataclass(frozen=True, slots=True)
class StageSummary:
    """The durations of one stage.

    Attributes
    ----------
    calls : number of calls.
    total_s : total time [s].
    median_ms, p99_ms : of one call [ms]; of more than `MAX_KEPT` calls, evenly chosen ones count.
    """

    calls: int
    total_s: float
    median_ms: float
    p99_ms: float


class _Stage:
    """Measures one stage; not reentrant."""

    __slots__ = ("calls", "durations", "every", "start", "total")

    def __init__(self) -> None:
        self.durations = array("d")
        self.calls = 0
        self.total = 0.0
        self.every = 1
        self.start = 0.0

    def __enter__(self) -> None:
        self.start = perf_counter()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.add(perf_counter() - self.start)

    def add(self, seconds: float) -> None:
        """Add a call; of many, keep every second one, then every fourth one, and so on."""
        if self.calls % self.every == 0:
            self.durations.append(seconds)
            if len(self.durations) > MAX_KEPT:
                self.durations = self.durations[::2]
                self.every *= 2
        self.calls += 1
        self.total += seconds


class StageTimer:
    """Durations of the calls of all stages, in bounded memory.

    `measure` is for one thread per stage, and a stage must not be nested in itself. Worker threads
    measure their own times and pass them to `record`.
    """

    def __init__(self) -> None:
        self._stages: dict[str, _Stage] = {}
        self._recording = Lock()

    def measure(self, stage: str) -> _Stage:
        """Return the context manager that measures its body as one call of `stage`."""
        try:
            return self._stages[stage]
        except KeyError:
            # setdefault, because a worker thread may record the first call of it meanwhile.
            return self._stages.setdefault(stage, _Stage())

    def record(self, stage: str, seconds: float) -> None:
        """Add one call of a stage that is not measured [s]; safe from any thread."""
        with self._recording:
            self.measure(stage).add(seconds)

    def summary(self) -> dict[str, StageSummary]:
        """Return the summary of each stage that ran, in the order of their first call."""
        return {name: _summary(stage) for name, stage in list(self._stages.items()) if stage.calls}


def _summary(stage: _Stage) -> StageSummary:
    ordered = sorted(stage.durations)
    last = len(ordered) - 1
    return StageSummary(
        calls=stage.calls,
        total_s=stage.total,
        median_ms=1e3 * (ordered[last // 2] + ordered[(last + 1) // 2]) / 2.0,
        # the nearest rank: 99 of 100 calls took no longer
        p99_ms=1e3 * ordered[-(-99 * len(ordered) // 100) - 1],
    )
